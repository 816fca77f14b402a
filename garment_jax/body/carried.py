"""What the body carries through a clip: pins, collider and limbs in the root frame, chunk by chunk (host)."""

from typing import NamedTuple

import numpy as np
import scipy.sparse

from garment_jax.body.kinematics import joint_positions
from garment_jax.body.limbs import Limbs
from garment_jax.body.root_frame import heading, to_root, yaw_matrix
from garment_jax.structs import Motion, Scene


class Carried(NamedTuple):
    """The `q` points that the body carries through a scene: pins, then the collider's vertices (static).

    `weighted` holds for each joint its weights times (x, y, z, 1) of the canonical points, metres.
    """

    pins: np.ndarray  # [p] int32 garment vertices, may be empty
    joints: np.ndarray  # [u] those that carry any point at all
    weighted: scipy.sparse.csr_array  # [q, 4 u] float64
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
    points = garment.template[pins]
    bones = np.zeros((0, 2), np.int32) if limbs is None else limbs.joints
    cap = np.zeros(0, np.int32)
    if collider and scene.collider is not None:
        cap = scene.collider.cap_loop
        used = np.concatenate([scene.collider.body_vertices, cap])
        points = np.concatenate([points, body.vertices[used]])
        weights = np.concatenate([weights, body.skin_weights[used]])
    joints = np.flatnonzero(weights.max(axis=0, initial=0.0) > 0)
    ones = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    weighted = (weights[:, joints, None] * ones[:, None]).reshape(len(points), 4 * len(joints))
    if len(cap):  # the mean of points is carried by the mean of their rows
        weighted, closing = np.split(weighted, [len(points) - len(cap)])
        weighted = np.concatenate([weighted, closing.mean(axis=0, keepdims=True)])
    return Carried(pins, joints, scipy.sparse.csr_array(weighted), bones)


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
    bones = positions[:, carried.bones].astype(np.float32)
    pins, collider = np.split(posed, [len(carried.pins)], axis=1)
    return CarriedPoses(pins, collider, bones)


def _posed(carried: Carried, rotations: np.ndarray, positions: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Return the points `[k, q, 3]` float32 of `pose_points`, in one product for all frames.

    Frame by frame the product has three columns, and takes thirty times as long. Sparse, as weights are: a
    dense one takes as long, and a BLAS of several threads keeps them turning for milliseconds after it,
    on cores that the networks and collisions need: with it a rollout took a quarter longer. In float64:
    a pin that is 2e-7 m off in float32 moved the cloth beside it by 80 times that (`edge_lengths`).
    """
    R, rest = rotations[:, carried.joints], joints[carried.joints].astype(np.float64)
    offset = positions[:, carried.joints] - (R @ rest[:, :, None])[..., 0]
    affine = np.concatenate([R, offset[..., None]], axis=3).transpose(1, 3, 0, 2)  # [u, 4, k, 3]
    rows = carried.weighted @ np.ascontiguousarray(affine).reshape(4 * len(rest), 3 * len(R))
    points = rows.astype(np.float32).reshape(len(rows), len(R), 3)
    return np.ascontiguousarray(points.transpose(1, 0, 2))
