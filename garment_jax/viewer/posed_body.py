"""The body for the page: its rest vertices, a few skin weights each, and the joints' matrices."""

from typing import NamedTuple

import numpy as np

from garment_jax.body.kinematics import joint_positions, pose_points
from garment_jax.structs import Motion, RiggedBody

WEIGHTS = 8  # joints that carry a vertex in the page
_SAMPLES = 24  # frames that the floor and the error of the weights are measured on


class PageBody(NamedTuple):
    """What the page needs to pose the body."""

    vertices: np.ndarray  # [b, 3] float32 canonical metres
    faces: np.ndarray  # [g, 3] int32
    joints: np.ndarray  # [b, 8] uint16, the joints that carry each vertex
    weights: np.ndarray  # [b, 8] float32, rows sum to 1
    error_mm: float  # largest difference from all weights, on sampled frames
    floor: float  # metres, height of the lowest vertex on these frames
    height: float  # metres, from the floor to the highest vertex on these frames


def joint_matrices(body: RiggedBody, motion: Motion, frames: np.ndarray) -> np.ndarray:
    """Return `[t, j, 3, 4]` float32: canonical points to metres from the root, one matrix a joint."""
    R = motion.rotations[frames].astype(np.float64)
    positions = joint_positions(R, np.zeros((len(frames), 3)), body)
    offset = positions - (R @ body.joints.astype(np.float64)[None, :, :, None])[..., 0]
    return np.concatenate([R, offset[..., None]], axis=-1).astype(np.float32)


def make_page_body(body: RiggedBody, motion: Motion, frames: np.ndarray) -> PageBody:
    """Return the body with its `WEIGHTS` largest weights a vertex, and what that changes."""
    count = min(WEIGHTS, body.skin_weights.shape[1])
    joints = np.argsort(-body.skin_weights, axis=1, kind="stable")[:, :count]
    weights = np.take_along_axis(body.skin_weights, joints, axis=1).astype(np.float64)
    weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)
    kept = np.zeros(body.skin_weights.shape)
    np.put_along_axis(kept, joints, weights, axis=1)
    sample = frames[np.linspace(0, len(frames) - 1, min(_SAMPLES, len(frames))).astype(int)]
    every_weight = _posed(body, body.skin_weights, motion, sample)
    few = _posed(body, kept, motion, sample)
    error = 1000.0 * float(np.linalg.norm(every_weight - few, axis=-1).max())
    floor = float(every_weight[..., 1].min())
    padding = ((0, 0), (0, WEIGHTS - count))
    return PageBody(
        body.vertices.astype(np.float32),
        body.faces,
        np.pad(joints, padding).astype(np.uint16),
        np.pad(weights, padding).astype(np.float32),
        error,
        floor,
        float(every_weight[..., 1].max()) - floor,
    )


def _posed(body: RiggedBody, weights: np.ndarray, motion: Motion, frames: np.ndarray) -> np.ndarray:
    rotations, root = motion.rotations[frames], motion.root[frames]
    positions = joint_positions(rotations, root, body)
    return pose_points(body.vertices, weights, rotations, positions, body.joints)
