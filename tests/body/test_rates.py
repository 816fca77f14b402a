"""Rates by value: what rounded frame times mean, what files leave unsaid, who counts where several speak."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.body.rates import (
    RATE_KEYS,
    body_rate,
    check_lengths,
    clip_rate,
    counts_frames,
    rate_in,
    rate_of_frame_time,
    rate_of_times,
    shared_rate,
    stated_rate,
)
from garment_jax.body.resample import sample_times

PATH = Path("walk.usd")


@pytest.mark.parametrize("rate", [24, 25, 30, 48, 50, 60, 72, 90, 100, 120, 144, 200, 240])
@pytest.mark.parametrize("decimals", [4, 5, 6, 7, 8])
def test_a_rounded_frame_time_means_its_rate_and_loses_no_frame(rate: int, decimals: int):
    written = float(f"{1 / rate:.{decimals}f}")
    cut = float(f"{np.floor(10**decimals / rate) / 10**decimals:.{decimals}f}")
    for seconds in (written, cut):
        if abs(1 / seconds / rate - 1) > 0.025 or (seconds == 0.0041 and rate == 240):
            continue  # 0.0041 is 243.9
        found = rate_of_frame_time(seconds)
        assert found == rate
        first, part = sample_times(100_000, rate, found)
        assert len(first) == 100_000
        assert first[-1] == 99_999
        assert not part.any()


def test_rates_of_television_and_odd_ones_stay_what_they_are():
    assert rate_of_frame_time(0.041708) == pytest.approx(24000 / 1001, rel=1e-12)
    assert rate_of_frame_time(0.0333667) == pytest.approx(30000 / 1001, rel=1e-12)
    assert rate_of_frame_time(0.016683) == pytest.approx(60000 / 1001, rel=1e-12)
    assert rate_of_frame_time(1 / 35.3) == pytest.approx(35.3, rel=1e-12)
    assert rate_of_frame_time(0.008) == 125.0


def test_times_give_a_rate_unless_they_count_frames_or_are_uneven():
    k = np.arange(40)
    assert rate_of_times((7 + k).astype(np.float64) / 30) == 30.0
    assert rate_of_times((k / 29.97).astype(np.float32).astype(np.float64)) == pytest.approx(29.97, rel=1e-5)
    assert rate_of_times(k.astype(np.float64)) is None
    assert rate_of_times(k[:1] / 30) is None
    assert rate_of_times(np.array([0.0, 1 / 30, 3 / 30])) is None
    assert counts_frames(k.astype(np.float64))
    assert counts_frames(5.0 * k)
    assert not counts_frames(k / 30)
    assert not counts_frames(k[:4].astype(np.float64))


@pytest.mark.parametrize("rate", [None, 0.0, -24.0, 1.0, float("inf"), float("nan"), 1e6])
def test_what_is_no_rate_is_not_stated(rate):
    assert stated_rate(rate) is None


def test_all_keys_are_known_and_odd_values_refused():
    for name in RATE_KEYS:
        assert rate_in({name: np.array(60.0), "poses": 1}, PATH) == 60.0
        assert rate_in({name: 60}, PATH) == 60.0
    assert rate_in({}, PATH) is None
    structured = np.zeros(1, [("a", "f4")])
    dates = np.array(["2020-01-01"], "M8[D]")
    for odd in (
        np.inf,
        np.nan,
        0,
        -30.0,
        "thirty",
        np.array(["x"]),
        np.zeros(2),
        structured,
        dates,
        [30],
        {},
    ):
        with pytest.raises(ValueError, match=r"walk.usd: 'fps' is"):
            rate_in({"fps": odd}, PATH)


def test_a_clips_rate_is_its_files_else_the_users():
    assert clip_rate(None, None, PATH) is None
    assert clip_rate(None, 30.0, PATH) == 30.0
    assert clip_rate(24.0, None, PATH) == 24.0
    assert clip_rate(24.0, 23.976, PATH) == 23.976
    with pytest.raises(ValueError, match=r"says 24 fps and --fps 30; cloth is not resampled"):
        clip_rate(24.0, 30.0, PATH)


def test_samples_by_frames_of_a_scene_are_counted():
    assert clip_rate(None, 30.0, PATH, frames_a_sample=0.5) == 60.0
    assert clip_rate(None, 24.0, PATH, frames_a_sample=2.0) == 12.0
    with pytest.raises(ValueError, match=r"0.5 frames of its scene a sample.*--fps, for example 30"):
        clip_rate(None, None, PATH, frames_a_sample=0.5)


def test_cloth_and_motion_of_one_file_have_one_rate():
    assert shared_rate(None, None, None, PATH, usual=30.0) == 30.0
    assert shared_rate(None, 60.0, None, PATH, usual=30.0) == 60.0
    assert shared_rate(None, None, 50.0, PATH, usual=30.0) == 50.0
    assert shared_rate(24.0, None, 50.0, PATH, usual=None) == 50.0
    with pytest.raises(ValueError, match=r"two rates for a file"):
        shared_rate(None, 60.0, 30.0, PATH, usual=None)
    with pytest.raises(ValueError, match=r"says 24 fps and --fps 30.*--source-fps"):
        shared_rate(24.0, 30.0, None, PATH, usual=None)


def test_a_body_of_vertices_has_its_cloths_rate():
    assert body_rate(None, PATH, clip=30.0) == 30.0
    assert body_rate(24.0, PATH, clip=None) == 24.0
    assert body_rate(24.0, PATH, clip=30.0, source_fps=30.0) == 30.0
    assert body_rate(None, PATH, clip=None, scene_fps=30.0, frames_a_sample=0.5) == 60.0
    with pytest.raises(ValueError, match=r"has 24 fps and its cloth 30.*--source-fps"):
        body_rate(24.0, PATH, clip=30.0)
    with pytest.raises(ValueError, match=r"no frame rate.*--fps"):
        body_rate(None, PATH, clip=None)


def test_refusals_do_not_contradict_each_other():
    """Where a file states its rate, --fps would be refused: the sentence on lengths does not ask for it."""
    with pytest.raises(ValueError, match=r"33 at 30 fps.*--fps, the motion's with --source-fps"):
        check_lengths(41, 33, 30.0, PATH, Path("walk.bvh"))
    with pytest.raises(
        ValueError, match=r"33 at its 24 fps; .*or give the motion's true rate with --source-fps"
    ):
        check_lengths(41, 33, 24.0, PATH, Path("walk.bvh"), stated=True)
    check_lengths(41, 41, 24.0, PATH, PATH)
