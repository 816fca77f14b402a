"""What the body carries through a clip: pins, collider and limbs in the root frame, chunk by chunk (host)."""

from typing import NamedTuple

import numpy as np

from garment_jax.body.kinematics import joint_positions
from garment_jax.body.limbs import Limbs
from garment_jax.body.root_frame import heading, to_root, yaw_matrix
from garment_jax.structs import Motion, Scene


class Carried(NamedTuple):
    """Points that the body carries through a scene (static)."""

    pins: np.ndarray  # [p] int32 garment vertices, may be empty
    points: np.ndarray  # [p + q, 3] canonical points: pins first, then the collider's body vertices
    weights: np.ndarray  # [p + q, j] skinning weights
    cap: np.ndarray  # [k] rows of `points` whose mean closes the collider, may be empty
    collider: np.ndarray  # [c] rows of `points` that are the collider's vertices, may be empty
    bones: np.ndarray  # [q, 2] joints at the ends of the limbs' bones, may be empty


class CarriedPoses(NamedTuple):
    """Where they are in `k` frames; metres, root frames."""

    pins: np.ndarray  # [k, p, 3]
    collider: np.ndarray  # [k, c, 3]
    bones: np.ndarray  # [k, q, 2, 3]


def carried_points(scene: Scene, *, collider: bool, limbs: Limbs | None = None) -> Carried:
    """Return the pins of `scene`, its collider's vertices if wanted and there, and the bones of `limbs`."""
    body, garment = scene.body, scene.garment
    pins = np.zeros(0, np.int32) if scene.pins is None else scene.pins.vertices
    weights = np.zeros((0, len(body.joints)), np.float32) if scene.pins is None else scene.pins.weights
    points, p = garment.template[pins], len(pins)
    bones = np.zeros((0, 2), np.int32) if limbs is None else limbs.joints
    if not collider or scene.collider is None:
        none = np.zeros(0, np.int64)
        return Carried(pins, points, weights, none, none, bones)
    c = scene.collider
    used = np.concatenate([c.body_vertices, c.cap_loop])
    points = np.concatenate([points, body.vertices[used]])
    weights = np.concatenate([weights, body.skin_weights[used]])
    rows = p + np.arange(len(used))
    split = len(c.body_vertices)
    return Carried(pins, points, weights, rows[split:], rows[:split], bones)


def pose_carried(carried: Carried, scene: Scene, motion: Motion, frames: slice) -> CarriedPoses:
    """Return the pins, the collider and the bones at `frames`."""
    rotations, root = motion.rotations[frames], motion.root[frames]
    none = np.zeros((len(rotations), 0, 3), np.float32)
    if not len(carried.points) and not len(carried.bones):
        return CarriedPoses(none, none, none[:, :, None].repeat(2, axis=2))
    yaw = heading(rotations[:, 0])
    # joints into the root frame rather than the points: there are a hundred times as many of these
    positions = to_root(joint_positions(rotations, root, scene.body), root.astype(np.float64), yaw)
    rotations = np.swapaxes(yaw_matrix(yaw), -1, -2)[:, None] @ rotations.astype(np.float64)
    posed = _posed(carried, rotations, positions, scene.body.joints) if len(carried.points) else none
    collider = posed[:, carried.collider]
    if len(carried.cap):
        collider = np.concatenate([collider, posed[:, carried.cap].mean(axis=1, keepdims=True)], axis=1)
    bones = positions[:, carried.bones].astype(np.float32)
    return CarriedPoses(posed[:, : len(carried.pins)], collider, bones)


def _posed(carried: Carried, rotations: np.ndarray, positions: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Return the points `[k, p + q, 3]` float32 of `pose_points`, in one product for all frames.

    Frame by frame the product has three columns, and takes thirty times as long.
    """
    used = np.flatnonzero(carried.weights.max(axis=0) > 0)
    R, rest = rotations[:, used], joints[used].astype(np.float64)
    offset = positions[:, used] - (R @ rest[:, :, None])[..., 0]
    affine = np.concatenate([R, offset[..., None]], axis=3).transpose(0, 2, 1, 3).reshape(3 * len(R), -1)
    ones = np.concatenate([carried.points, np.ones((len(carried.points), 1))], axis=1)
    weighted = (carried.weights[:, used, None] * ones[:, None]).reshape(len(ones), -1)
    planes = (affine @ weighted.T).astype(np.float32).reshape(len(R), 3, -1)
    return np.ascontiguousarray(planes.transpose(0, 2, 1))
