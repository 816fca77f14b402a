"""How minutes are divided: sums, bounds, and what is left at a bound."""

import pytest

from garment_jax.learning.budget import (
    FEWEST_FRAMES,
    MOST_FRAMES,
    STAGES,
    clip_length,
    divide,
    frames_within,
    kept_back_within,
    steps_within,
)


@pytest.mark.parametrize("minutes", [2.0, 10.0, 60.0, 600.0])
def test_the_shares_are_the_whole(minutes: float) -> None:
    shares = divide(minutes)
    assert sum(shares) == pytest.approx(60 * minutes)
    assert min(shares) > 0
    assert shares.training > shares.simulating


@pytest.mark.parametrize("minutes", [1.9, -1.0, float("nan"), float("inf")])
def test_too_few_minutes_are_refused(minutes: float) -> None:
    with pytest.raises(ValueError, match=r"--minutes .* is not between 2 and 100,000; 30 give"):
        divide(minutes)


def test_frames_fill_the_seconds_with_the_frames_before_each_clip() -> None:
    frames = frames_within(1_000.0, per_frame=0.2, start=49, workers=2)
    length = clip_length(frames)
    assert length == 350
    assert frames * (1 + 49 / length) * 0.2 / 2 == pytest.approx(1_000.0, rel=1e-3)
    assert frames_within(1.0, per_frame=0.2, start=49, workers=1) == FEWEST_FRAMES
    assert frames_within(1e9, per_frame=0.2, start=49, workers=1) == MOST_FRAMES
    assert [clip_length(n) for n in (400, 1_600, 9_000)] == [112, 200, 350]
    assert [kept_back_within(s, per_frame=0.1) for s in (1.0, 180.0, 1e6)] == [112, 300, 900]


def test_steps_fill_the_seconds_in_the_stages_shares() -> None:
    per_step = dict.fromkeys(STAGES, 0.5)
    steps = steps_within(2_000.0, per_step)
    assert sum(steps.values()) * 0.5 == pytest.approx(2_000.0, rel=2e-3)
    assert steps["column_rnn"] == int(2_000.0 * 0.47 / 0.5)
    without = steps_within(2_000.0, {k: v for k, v in per_step.items() if k != "column_rnn"})
    assert set(without) == set(STAGES) - {"column_rnn"}
    assert without["warm_up"] > steps["warm_up"]


def test_a_stage_at_its_bound_leaves_its_seconds_to_the_others() -> None:
    per_step = {**dict.fromkeys(STAGES, 1.0), "generative": 1e-3}
    steps = steps_within(1_000.0, per_step)
    assert steps["generative"] == STAGES["generative"][2]
    assert sum(n * per_step[name] for name, n in steps.items()) == pytest.approx(1_000.0, abs=6)
    fewest = steps_within(0.0, per_step)
    assert fewest == {name: least for name, (_, least, _) in STAGES.items()}
