"""Which frames a recurrent training sees when: lanes that run through clips window by window.

The whole schedule is drawn from the seed at the start, so that window k is the same in a run that was
stopped and resumed.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class LaneWindow(NamedTuple):
    """What every lane reads in one window; L lanes."""

    clip: np.ndarray  # [L] index of the clip
    start: np.ndarray  # [L] its first frame
    fresh: np.ndarray  # [L] bool, the lane begins with this window
    true_start: np.ndarray  # [L] bool, it began from a true frame (else from the skinned template)
    age: np.ndarray  # [L] frames since the lane began

    def part(self, lanes: slice) -> "LaneWindow":
        """Return these lanes alone."""
        return LaneWindow(*(field[lanes] for field in self))


def check_window(lengths: Sequence[int], window: int, stage: str = "motion") -> None:
    """Raise `ValueError` unless a clip of `lengths` frames holds a window of the stage."""
    if not any(length >= window for length in lengths):
        raise ValueError(
            f"{stage}.window = {window} frames, but the longest training clip has {max(lengths)}; shorten it."
        )


def make_schedule(
    lengths: list[int],
    *,
    lanes: int,
    window: int,
    steps: int,
    seed: int,
    from_first: float,
    true_starts: float,
    lane_windows: int,
) -> list[LaneWindow]:
    """Return the windows of `steps` steps.

    A lane draws a clip (by length) and a start (a clip's first frame with probability `from_first`), runs
    for at most `lane_windows` windows, and draws anew. Raises `ValueError` when no clip holds a window, or
    when lanes are none or end before they begin.
    """
    if lanes < 1 or lane_windows < 1:
        raise ValueError(f"{lanes} lanes of {lane_windows} windows are no training; give at least 1 of each.")
    check_window(lengths, window)
    weights = np.array([length if length >= window else 0 for length in lengths], float)
    columns = [
        _lane(
            np.random.default_rng([seed, lane]),
            lengths,
            weights / weights.sum(),
            window,
            steps,
            from_first,
            true_starts,
            lane_windows,
        )
        for lane in range(lanes)
    ]
    stacked = np.array(columns).transpose(1, 2, 0)  # [steps, field, lanes]
    return [LaneWindow(s[0], s[1], s[2].astype(bool), s[3].astype(bool), s[4]) for s in stacked]


def _lane(
    rng: np.random.Generator,
    lengths: list[int],
    weights: np.ndarray,
    window: int,
    steps: int,
    from_first: float,
    true_starts: float,
    lane_windows: int,
) -> list[tuple[int, int, bool, bool, int]]:
    rows: list[tuple[int, int, bool, bool, int]] = []
    while len(rows) < steps:
        clip = int(rng.choice(len(lengths), p=weights))
        first, true = rng.random() < from_first, rng.random() < true_starts
        start = 0 if first else int(rng.integers(0, lengths[clip] - window + 1))
        for k in range(min(lane_windows, (lengths[clip] - start) // window)):
            rows.append((clip, start + k * window, k == 0, true, k * window))
    return rows[:steps]


def frame_weights(lanes: LaneWindow, window: int, grace: int) -> np.ndarray:
    """Return how much each frame's error counts, `[W, L]`.

    From 0.2 up to 1 over the first `grace` frames of a lane that began from the skinned template in the
    middle of a clip, whose folds it cannot know; 1 elsewhere (all clips' first frames are reached alike,
    so what hangs there can be learnt).
    """
    age = lanes.age[None, :] + np.arange(window)[:, None]
    ramp = np.clip(0.2 + 0.8 * age / max(grace, 1), 0.2, 1.0)
    began = lanes.start - lanes.age
    unknowable = ~lanes.true_start & (began > 0)
    return np.where(unknowable, ramp, 1.0).astype(np.float32)


def repeated_last(frames: np.ndarray, length: int) -> np.ndarray:
    """Return `frames` `[k, ...]` with the last one repeated up to `length`: one compiled program."""
    return np.concatenate([frames, np.repeat(frames[-1:], length - len(frames), axis=0)])
