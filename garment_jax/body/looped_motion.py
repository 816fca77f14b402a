"""A motion repeated for as long as one likes, its seam blended over a few frames."""

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.root_frame import heading, yaw_matrix
from garment_jax.structs import Motion

BLEND = 15  # frames


def looped_motion(motion: Motion, frames: int, *, blend: int = BLEND) -> Motion:
    """Return `frames` frames of `motion` repeated.

    The clip's last `blend` frames turn into its first ones: joints by slerp along the shortest arc, heights,
    speeds and yaw rates linearly, smoothstep in time. Each repetition goes on where and whither the body
    stood, so that the root neither jumps nor runs back. Raises `ValueError` for a clip that is too short.
    """
    count = len(motion.root)
    if count <= 2 * blend:
        raise ValueError(f"a clip of {count} frames is too short to blend {blend}; take a longer one.")
    yaw = np.unwrap(heading(motion.rotations[:, 0]))
    local = yaw_matrix(-yaw)[:, None] @ motion.rotations.astype(np.float64)
    turn = np.diff(yaw, append=2 * yaw[-1] - yaw[-2])  # to the next frame
    shift = np.diff(motion.root.astype(np.float64), axis=0)
    shift = np.einsum("tab,tb->ta", yaw_matrix(-yaw), np.concatenate([shift, shift[-1:]]))
    u = (np.arange(blend) + 1) / (blend + 1)
    u = u * u * (3 - 2 * u)
    period = count - blend

    def cycle(x: np.ndarray) -> np.ndarray:
        weight = u.reshape(-1, *[1] * (x.ndim - 1))
        return np.concatenate([(1 - weight) * x[period:] + weight * x[:blend], x[blend:period]])

    poses = np.concatenate([blended_rotations(local[period:], local[:blend], u), local[blend:period]])
    which = np.arange(frames) % period
    steps, turns = cycle(shift)[which], cycle(turn)[which]
    angle = yaw[0] + np.concatenate([[0.0], np.cumsum(turns[:-1])])
    walk = np.einsum("tab,tb->ta", yaw_matrix(angle), steps)
    root = motion.root[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(walk[:-1], axis=0)])
    root[:, 1] = cycle(motion.root[:, 1].astype(np.float64))[which]  # heights repeat, they do not add up
    rotations = (yaw_matrix(angle)[:, None] @ poses[which]).astype(np.float32)
    return Motion(rotations, root, motion.fps)


def blended_rotations(a: np.ndarray, b: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return rotations `[k, j, 3, 3]` a part `u` `[k]` of the shortest way from `a` to `b`."""
    shape = a.shape
    first, last = (Rotation.from_matrix(x.reshape(-1, 3, 3)) for x in (a, b))
    way = (first.inv() * last).as_rotvec() * np.repeat(u, shape[1])[:, None]
    return (first * Rotation.from_rotvec(way)).as_matrix().reshape(shape)
