"""The root frame: translation and heading of the root joint removed, tilt kept.

Gravity points the same way in every frame, and a rollout does not change when the whole motion is
moved or turned about the up axis (method, "Root frame").
"""

import numpy as np

from garment_jax.body.frame_windows import stretches
from garment_jax.structs import Motion


def headings(motion: Motion) -> np.ndarray:
    """Return the yaw of the root joint in every frame, `[t]` radians, float64 (`heading`)."""
    parts = [heading(motion.rotations[frames, 0]) for _, frames in stretches(len(motion.root))]
    return np.concatenate(parts) if parts else np.zeros(0)


def heading(rotation: np.ndarray) -> np.ndarray:
    """Return the yaw about +Y of root rotations `[..., 3, 3]`, radians, float64.

    The twist of the swing-twist split: turning the world by a adds exactly a, and it is singular
    only for a root that hangs upside down (where 0 is returned).
    """
    R = rotation.astype(np.float64)
    return np.arctan2(R[..., 0, 2] - R[..., 2, 0], R[..., 0, 0] + R[..., 2, 2])


def yaw_matrix(angle: np.ndarray) -> np.ndarray:
    """Return the rotation `[..., 3, 3]` by `angle` (radians) about +Y."""
    c, s, o, i = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    rows = [[c, o, s], [o, i, o], [-s, o, c]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def to_root(points: np.ndarray, root: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Express world `points` `[t, n, 3]` in the root frames of `root` `[t, 3]` and `yaw` `[t]`.

    Row vectors: R(-yaw) (x - root) is (x - root) @ R(yaw).
    """
    return (points - root[:, None]) @ yaw_matrix(yaw).astype(points.dtype)


def from_root(points: np.ndarray, root: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Put root-frame `points` `[t, n, 3]` back into the world; the inverse of `to_root`."""
    turned = points @ np.swapaxes(yaw_matrix(yaw), -1, -2).astype(points.dtype)
    return turned + root[:, None].astype(points.dtype)


def carry_over(root: np.ndarray, yaw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return `turn` `[t, 3, 3]` and `shift` `[t, 3]` that re-express frame t-1 in frame t's root.

    A row vector v of frame t-1's root frame is v @ turn[t] + shift[t] in frame t's: the cloth hung
    in the world while the body moved on. Frame 0 has no predecessor: identity and zero.
    Computed in float64, returned in float32.
    """
    previous = np.maximum(np.arange(len(root)) - 1, 0)
    turn = yaw_matrix(yaw - yaw[previous])
    shift = (root[previous] - root).astype(np.float64)[:, None] @ yaw_matrix(yaw)
    return turn.astype(np.float32), shift[:, 0].astype(np.float32)
