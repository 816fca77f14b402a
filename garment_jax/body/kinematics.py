"""Forward kinematics and linear blend skinning of a rigged body (host, NumPy, float64)."""

import numpy as np

from garment_jax.structs import Collider, Motion, RiggedBody


def joint_positions(rotations: np.ndarray, root: np.ndarray, body: RiggedBody) -> np.ndarray:
    """Return the joints' world positions `[t, j, 3]` (metres, float64).

    `rotations` `[t, j, 3, 3]` are world rotations from the canonical pose and `root` `[t, 3]` is joint
    0's world position: p_j = p_parent + R_parent (joints_j - joints_parent). Parents come before
    their children in `body.parents`.
    """
    rest = body.joints.astype(np.float64)
    positions = np.zeros((len(root), len(rest), 3))
    positions[:, 0] = root
    for j in range(1, len(rest)):
        parent = int(body.parents[j])
        bone = rest[j] - rest[parent]
        positions[:, j] = positions[:, parent] + rotations[:, parent].astype(np.float64) @ bone
    return positions


def pose_points(
    points: np.ndarray,
    weights: np.ndarray,
    rotations: np.ndarray,
    positions: np.ndarray,
    joints: np.ndarray,
) -> np.ndarray:
    """Return canonical `points` `[q, 3]` posed by linear blend skinning, `[t, q, 3]` world metres.

    `weights` `[q, j]` sum to 1 over joints; `positions` `[t, j, 3]` as from `joint_positions`. Only the
    joints that carry weight at all take part: most carry none.
    """
    used = np.flatnonzero(weights.max(axis=0) > 0)
    R = rotations[:, used].astype(np.float64)
    rest = joints[used].astype(np.float64)
    offset = positions[:, used] - (R @ rest[:, :, None])[..., 0]
    return _blend(points.astype(np.float64), weights[:, used].astype(np.float64), R, offset)


def _blend(points: np.ndarray, weights: np.ndarray, R: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Return sum_j w_j (R_j p + o_j), as one product of [q, 4 j] weighted points and [4 j, 3] a frame."""
    ones = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    weighted = (weights[:, :, None] * ones[:, None]).reshape(len(points), -1)
    affine = np.concatenate([np.swapaxes(R, -1, -2), offset[:, :, None]], axis=2)
    return weighted @ affine.reshape(len(R), -1, 3)


def pose_body(body: RiggedBody, motion: Motion, frames: np.ndarray | slice) -> np.ndarray:
    """Return the body's vertices at `frames`, `[k, b, 3]` float32 world metres."""
    rotations, root = motion.rotations[frames], motion.root[frames]
    positions = joint_positions(rotations, root, body)
    posed = pose_points(body.vertices, body.skin_weights, rotations, positions, body.joints)
    return posed.astype(np.float32)


def collider_points(collider: Collider, body_vertices: np.ndarray) -> np.ndarray:
    """Return the collider's vertices `[..., c, 3]` from posed body vertices `[..., b, 3]`."""
    points = body_vertices[..., collider.body_vertices, :]
    if not len(collider.cap_loop):
        return points
    cap = body_vertices[..., collider.cap_loop, :].mean(axis=-2, keepdims=True)
    return np.concatenate([points, cap], axis=-2)
