"""Frames before a motion's first, so that a garment hangs and follows before it is looked at."""

from typing import Any

import numpy as np

from garment_jax.body.frame_windows import FrameWindows
from garment_jax.body.root_frame import heading, yaw_matrix
from garment_jax.structs import Motion

LONGEST = 100_000  # frames; cloth hangs after a hundred
SETTLE, BLEND = 0.48, 0.39  # parts of the preroll; the rest holds the first pose


def preroll_motion(motion: Motion, frames: int) -> Motion:
    """Return `frames` frames that go before `motion`: canonical pose, a smoothstep blend, the first pose.

    As `into_first_pose`. Raises `ValueError` as `check_preroll`.
    """
    check_preroll(frames)
    # however short the preroll is, its last frame is the first pose
    u = np.clip((np.arange(frames) / max(frames - 1, 1) - SETTLE) / BLEND, 0.0, 1.0)
    before = into_first_pose(motion, smoothstep(u))
    return before._replace(rotations=before.rotations.astype(motion.rotations.dtype))


def check_preroll(frames: int) -> None:
    """Raise `ValueError` for a negative length, or one of more than `LONGEST`."""
    if frames < 0:
        raise ValueError(f"--preroll {frames} is negative; give the number of frames, 0 for none.")
    if frames > LONGEST:
        raise ValueError(f"--preroll {frames} is hours of motion; give {LONGEST} frames at most, such as 90.")


def smoothstep(u: np.ndarray) -> np.ndarray:
    """Return 3 u^2 - 2 u^3 of `u` in [0, 1]: from 0 to 1 without a jump of speed."""
    return u * u * (3.0 - 2.0 * u)


def into_first_pose(motion: Motion, share: np.ndarray, *, yaw: float | None = None) -> Motion:
    """Return frames between the canonical pose (`share` 0) and the first (1), `share` `[k]`; float64.

    The root stands still at the first frame's position, and the canonical pose has its heading, or `yaw`
    (radians). Joints turn along the shortest arc (slerp of world rotations).
    """
    from scipy.spatial.transform import Rotation, Slerp  # half a second, which few motions need

    first = motion.rotations[:1][0].astype(np.float64)
    turned = yaw_matrix(heading(first[:1]) if yaw is None else np.array([yaw]))
    canonical = np.repeat(turned, len(first), axis=0)
    rotations = np.zeros((len(share), *first.shape))
    if len(share):
        for j in range(len(first)):
            pair = Rotation.from_matrix(np.stack([canonical[j], first[j]]))
            rotations[:, j] = Slerp([0.0, 1.0], pair)(share).as_matrix()
    return Motion(rotations, np.repeat(motion.root[:1], len(share), axis=0), motion.fps)


def with_preroll(motion: Motion, frames: int) -> Motion:
    """Return `motion` with its preroll in front; rotations that are read in stretches still are."""
    before = preroll_motion(motion, frames)
    if not frames:
        return motion
    root, after = np.concatenate([before.root, motion.root]), motion.rotations
    if not isinstance(after, FrameWindows):
        return Motion(np.concatenate([before.rotations, after]), root, motion.fps)

    def read(start: int, stop: int) -> np.ndarray:
        early, late = before.rotations[start:stop], after[max(start - frames, 0) : max(stop - frames, 0)]
        return np.concatenate([early, late])

    rotations: Any = FrameWindows(read, (len(root), *after.shape[1:]), after.dtype.str)
    return Motion(rotations, root, motion.fps)
