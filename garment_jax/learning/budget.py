"""How the minutes are divided: what is simulated, and the steps of each stage, from measured seconds."""

from collections.abc import Mapping
from typing import NamedTuple

LEAST_MINUTES = 2.0
SIMULATING = 0.4  # part of what measuring leaves
FEWEST_FRAMES, MOST_FRAMES = 400, 40_000  # to learn from; 40,000 of 2,800 vertices fill 4 GB of disk
FEWEST_KEPT_BACK, MOST_KEPT_BACK = 112, 900
SHORTEST_CLIP, LONGEST_CLIP = 112, 350  # frames
# Part of the training's seconds, and bounds of the steps. Of configs/skirt.toml the column RNN takes half:
# more of it pays longest.
STAGES = {
    "generative": (0.12, 60, 3_000),
    "warm_up": (0.20, 120, 12_000),
    "motion": (0.13, 6, 3_000),
    "detail": (0.08, 40, 3_000),
    "column_rnn": (0.47, 60, 20_000),
}


class Shares(NamedTuple):
    """Seconds of each part of the work."""

    simulating: float
    training: float
    measuring: float


def divide(minutes: float) -> Shares:
    """Return what the minutes are for. Raises `ValueError` for fewer than anything can be learnt in."""
    if not LEAST_MINUTES <= minutes < 100_000:  # NaN is no number either
        raise ValueError(
            f"--minutes {minutes:g} is not between {LEAST_MINUTES:g} and 100,000; 30 give a usable model."
        )
    seconds = 60.0 * minutes
    measuring = min(max(0.08 * seconds, 40.0), 240.0)
    simulating = SIMULATING * (seconds - measuring)
    return Shares(simulating, seconds - measuring - simulating, measuring)


def clip_length(frames: int) -> int:
    """Return how long clips are of which there are `frames` in all: eight at least, not all too short."""
    return min(max(frames // 8, SHORTEST_CLIP), LONGEST_CLIP)


def frames_within(seconds: float, *, per_frame: float, start: int, workers: int) -> int:
    """Return how many frames to learn from can be simulated, `FEWEST_FRAMES` at least.

    `per_frame`: seconds of one process; `start`: frames before the first of every clip, which take as long.
    """
    frames = seconds * workers / per_frame
    for _ in range(3):  # the length of clips depends on the number of frames, and that on the length
        length = clip_length(int(frames))
        frames = seconds * workers / (per_frame * (1 + start / length))
    return min(max(int(frames), FEWEST_FRAMES), MOST_FRAMES)


def kept_back_within(seconds: float, *, per_frame: float) -> int:
    """Return how many frames are kept back: a sixth of what `seconds` of one process simulate, in bounds."""
    return min(max(int(seconds / per_frame / 6), FEWEST_KEPT_BACK), MOST_KEPT_BACK)


def steps_within(seconds: float, per_step: Mapping[str, float]) -> dict[str, int]:
    """Return the steps of the stages in `per_step` (seconds each) that fill `seconds`, within their bounds.

    What stages leave at their upper bounds goes to the others, in proportion.
    """
    steps: dict[str, int] = {}
    left, open_stages = seconds, list(per_step)
    while open_stages:
        whole = sum(STAGES[name][0] for name in open_stages)
        wanted = {name: int(left * STAGES[name][0] / whole / per_step[name]) for name in open_stages}
        bounded = {
            name: _bounded(name, count) for name, count in wanted.items() if _bounded(name, count) != count
        }
        if not bounded:
            return {name: (steps | wanted)[name] for name in per_step}
        steps |= bounded
        left = max(left - sum(bounded[name] * per_step[name] for name in bounded), 0.0)
        open_stages = [name for name in open_stages if name not in bounded]
    return {name: steps[name] for name in per_step}


def _bounded(name: str, count: int) -> int:
    _, fewest, most = STAGES[name]
    return min(max(count, fewest), most)
