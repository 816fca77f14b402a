"""Motions at another frame rate: between two frames, positions go straight and rotations the shortest way."""

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.rates import SAME_RATE


def sample_times(frames: int, fps: float, source_fps: float, skip: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return for every output frame the source frame before it `[t]` and how far beyond it is, [0, 1).

    `frames` at `source_fps` become frames at `fps`, without the first `skip`. Raises `ValueError` for rates
    and numbers of frames that mean nothing.
    """
    for option, rate in (("--fps", fps), ("--source-fps", source_fps)):
        if not 1.0 <= rate <= 1e4:
            raise ValueError(f"{option} {rate:g} must lie between 1 and 10000 frames a second.")
    if not 0 <= skip < frames:
        raise ValueError(f"--skip {skip} leaves nothing of {frames} frames; take 0 to {frames - 1}.")
    step = _whole(source_fps / fps)
    count = int((frames - 1 - skip) / step + 1e-6) + 1
    time = np.minimum(skip + np.arange(count) * step, frames - 1)
    first = np.floor(time + 1e-6).astype(int)
    part = np.maximum(time - first, 0.0)
    return first, part


def _whole(step: float) -> float:
    """Return a step of a whole number of frames, or a whole number of steps a frame, exactly.

    Files say 0.041708 s where 1 / 23.976 is meant; the last frame must not be lost over the difference.
    """
    many = max(round(step), 1) if step >= 1 else 1 / max(round(1 / step), 1)
    return many if abs(step / many - 1) < SAME_RATE else step


def between(values: np.ndarray, first: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return `values` `[s, k]` at the times of `sample_times`, `[t, k]`."""
    after = np.minimum(first + 1, len(values) - 1)
    return values[first] + part[:, None] * (values[after] - values[first])


def slerp(rotations: np.ndarray, first: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return one joint's `rotations` `[s, 3, 3]` at the times of `sample_times`, `[t, 3, 3]`."""
    before = rotations[first]
    if not part.any():
        return before
    after = rotations[np.minimum(first + 1, len(rotations) - 1)]
    turn = Rotation.from_matrix(np.swapaxes(before, -1, -2) @ after).as_rotvec()
    return before @ Rotation.from_rotvec(part[:, None] * turn).as_matrix()
