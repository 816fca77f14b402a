"""What the body carries through a clip: pins, collider and limbs in the root frame, chunk by chunk (host)."""

from typing import NamedTuple

import numpy as np

from garment_jax.body.kinematics import joint_positions
from garment_jax.body.limbs import Limbs
from garment_jax.body.root_frame import heading, to_root, yaw_matrix
from garment_jax.structs import Motion, Scene


class Carried(NamedTuple):
    """The `q` points that the body carries through a scene, pins first (static).

    `weighted` holds for each joint its weights times (x, y, z, 1) of the canonical points, metres.
    """

    pins: np.ndarray  # [p] int32 garment vertices, may be empty
    joints: np.ndarray  # [u] those that carry any point at all
    weighted: np.ndarray  # [4 u, q] float64
    cap: np.ndarray  # [k] points whose mean closes the collider, may be empty
    collider: np.ndarray  # [c] points that are the collider's vertices, may be empty
    bones: np.ndarray  # [b, 2] joints at the ends of the limbs' bones, may be empty


class CarriedPoses(NamedTuple):
    """Where they are in `k` frames; metres, root frames."""

    pins: np.ndarray  # [k, p, 3]
    collider: np.ndarray  # [k, c, 3]
    bones: np.ndarray  # [k, b, 2, 3]


def carried_points(scene: Scene, *, collider: bool, limbs: Limbs | None = None) -> Carried:
    """Return the pins of `scene`, its collider's vertices if wanted and there, and the bones of `limbs`."""
    body, garment = scene.body, scene.garment
    pins = np.zeros(0, np.int32) if scene.pins is None else scene.pins.vertices
    weights = np.zeros((0, len(body.joints)), np.float32) if scene.pins is None else scene.pins.weights
    points, cap, shell = garment.template[pins], np.zeros(0, np.int64), np.zeros(0, np.int64)
    bones = np.zeros((0, 2), np.int32) if limbs is None else limbs.joints
    if collider and scene.collider is not None:
        c = scene.collider
        used = np.concatenate([c.body_vertices, c.cap_loop])
        points = np.concatenate([points, body.vertices[used]])
        weights = np.concatenate([weights, body.skin_weights[used]])
        shell, cap = np.split(len(pins) + np.arange(len(used)), [len(c.body_vertices)])
    joints = np.flatnonzero(weights.max(axis=0, initial=0.0) > 0)
    ones = np.concatenate([points, np.ones((len(points), 1))], axis=1).T
    weighted = (weights.T[joints, None] * ones[None]).reshape(4 * len(joints), len(points))
    return Carried(pins, joints, weighted, cap, shell, bones)


def pose_carried(carried: Carried, scene: Scene, motion: Motion, frames: slice) -> CarriedPoses:
    """Return the pins, the collider and the bones at `frames`."""
    rotations, root = motion.rotations[frames], motion.root[frames]
    none = np.zeros((len(rotations), 0, 3), np.float32)
    if not len(carried.joints) and not len(carried.bones):
        return CarriedPoses(none, none, none[:, :, None].repeat(2, axis=2))
    yaw = heading(rotations[:, 0])
    # joints into the root frame rather than the points: there are a hundred times as many of these
    positions = to_root(joint_positions(rotations, root, scene.body), root.astype(np.float64), yaw)
    rotations = np.swapaxes(yaw_matrix(yaw), -1, -2)[:, None] @ rotations.astype(np.float64)
    posed = _posed(carried, rotations, positions, scene.body.joints)
    collider = posed[:, carried.collider]
    if len(carried.cap):
        collider = np.concatenate([collider, posed[:, carried.cap].mean(axis=1, keepdims=True)], axis=1)
    bones = positions[:, carried.bones].astype(np.float32)
    return CarriedPoses(posed[:, : len(carried.pins)], collider, bones)


def _posed(carried: Carried, rotations: np.ndarray, positions: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Return the points `[k, q, 3]` float32 of `pose_points`, in one product for all frames.

    Frame by frame the product has three columns, and takes thirty times as long. In float64:
    a pin that is 2e-7 m off in float32 moved the cloth beside it by 80 times that (`edge_lengths`).
    """
    R, rest = rotations[:, carried.joints], joints[carried.joints].astype(np.float64)
    offset = positions[:, carried.joints] - (R @ rest[:, :, None])[..., 0]
    affine = np.concatenate([R, offset[..., None]], axis=3).transpose(0, 2, 1, 3).reshape(3 * len(R), -1)
    planes = (affine @ carried.weighted).astype(np.float32).reshape(len(R), 3, -1)
    return np.ascontiguousarray(planes.transpose(0, 2, 1))
