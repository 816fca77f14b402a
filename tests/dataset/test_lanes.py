"""Lanes run through clips window by window, the same on every run."""

import itertools

import numpy as np
import pytest

from garment_jax.dataset.lanes import LaneWindow, frame_weights, make_schedule

LENGTHS = [23, 4, 40, 12]
WINDOW, STEPS, LANES = 5, 200, 6


def schedule(**changes) -> list[LaneWindow]:
    settings = {"lanes": LANES, "window": WINDOW, "steps": STEPS, "seed": 3}
    settings |= {"from_first": 0.4, "true_starts": 0.3, "lane_windows": 3}
    return make_schedule(LENGTHS, **{**settings, **changes})


def test_it_is_a_function_of_the_seed_and_a_longer_one_begins_alike():
    again, longer, other = schedule(), schedule(steps=2 * STEPS), schedule(seed=4)
    for step, lanes in enumerate(schedule()):
        for field, same, more in zip(lanes, again[step], longer[step], strict=True):
            np.testing.assert_array_equal(field, same)
            np.testing.assert_array_equal(field, more)
    assert any((a.start != b.start).any() for a, b in zip(schedule(), other, strict=True))


def test_windows_lie_inside_their_clips_and_short_clips_are_left_out():
    lengths = np.array(LENGTHS)
    for lanes in schedule():
        assert (lanes.start >= 0).all()
        assert (lanes.start + WINDOW <= lengths[lanes.clip]).all()
        assert not (lanes.clip == 1).any()


def test_a_lane_goes_on_where_it_was_or_begins_anew():
    windows = schedule()
    assert windows[0].fresh.all()
    longest = 0
    for before, now in itertools.pairwise(windows):
        on = ~now.fresh
        np.testing.assert_array_equal(now.clip[on], before.clip[on])
        np.testing.assert_array_equal(now.start[on], before.start[on] + WINDOW)
        np.testing.assert_array_equal(now.age[on], before.age[on] + WINDOW)
        np.testing.assert_array_equal(now.true_start[on], before.true_start[on])
        assert not now.age[now.fresh].any()
        longest = max(longest, int(now.age.max()))
    assert longest == 2 * WINDOW  # at most three windows


def test_starts_have_the_asked_shares():
    fresh = [
        (lanes.start[k], lanes.true_start[k])
        for lanes in schedule(steps=4000)
        for k in range(LANES)
        if lanes.fresh[k]
    ]
    starts, true = np.array(fresh).T
    assert abs(true.mean() - 0.3) < 0.03
    assert 0.4 <= (starts == 0).mean() < 0.5  # a random start may be frame 0 too
    assert all((lanes.start[lanes.fresh] == 0).all() for lanes in schedule(from_first=1.0))
    assert not any(lanes.true_start.any() for lanes in schedule(true_starts=0.0))


def test_weights_rise_only_after_a_skinned_start_within_a_clip():
    lanes = LaneWindow(
        clip=np.zeros(4, int),
        start=np.array([0, 7, 7, 12]),
        fresh=np.array([True, True, True, False]),
        true_start=np.array([False, True, False, False]),
        age=np.array([0, 0, 0, 5]),
    )
    weight = frame_weights(lanes, WINDOW, 8)
    assert weight.shape == (WINDOW, 4)
    assert (weight[:, :2] == 1).all()  # a clip's first frame, a true frame: what hangs there can be known
    np.testing.assert_allclose(weight[:, 2], 0.2 + 0.8 * np.arange(5) / 8, rtol=1e-6)
    np.testing.assert_allclose(weight[:, 3], [0.7, 0.8, 0.9, 1.0, 1.0], rtol=1e-6)
    assert (frame_weights(lanes, WINDOW, 0) >= 0.2).all()


def test_a_window_longer_than_every_clip_is_refused():
    with pytest.raises(ValueError, match=r"motion\.window = 41 frames, but the longest training clip has 40"):
        schedule(window=41)


@pytest.mark.parametrize("change", [{"lanes": 0}, {"lane_windows": 0}])
def test_lanes_that_never_run_are_refused(change):
    with pytest.raises(ValueError, match="are no training; give at least 1 of each"):
        schedule(**change)
