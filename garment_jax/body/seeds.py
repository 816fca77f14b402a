"""Seed points on the part of the body that the garment covers (paper 3.2)."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from garment_jax.body.kinematics import joint_positions
from garment_jax.body.root_frame import yaw_matrix
from garment_jax.geometry.rigid_fit import nearest_rotations
from garment_jax.structs import Motion, Scene

COVER_DISTANCE = 0.2  # metres from the garment at which the body still counts as covered


class Seeds(NamedTuple):
    """Seed points of a body (static)."""

    points: np.ndarray  # [m, 3] float32 canonical, origin at the canonical root joint
    weights: np.ndarray  # [m, j] float32 skinning weights of the body at the points


def make_seeds(scene: Scene, count: int) -> Seeds:
    """Return `count` body vertices under the garment, spread by farthest-point sampling.

    Candidates are the collider's vertices (the whole body's, without a collider) within 20 cm of the
    template. Raises `ValueError` when fewer than `count` qualify.
    """
    body, garment = scene.body, scene.garment
    all_vertices = np.arange(len(body.vertices))
    candidates = all_vertices if scene.collider is None else scene.collider.body_vertices
    near = KDTree(garment.template).query(body.vertices[candidates])[0] < COVER_DISTANCE
    candidates = candidates[near]
    if len(candidates) < count:
        raise ValueError(
            f"body.seeds = {count}, but only {len(candidates)} body vertices lie within "
            f"{COVER_DISTANCE * 100:.0f} cm of the garment; ask for fewer seeds or check the units."
        )
    points = body.vertices[candidates].astype(np.float64)
    chosen = farthest_points(points, count)
    origin = body.joints[0].astype(np.float64)
    return Seeds(
        (points[chosen] - origin).astype(np.float32), body.skin_weights[candidates[chosen]].astype(np.float32)
    )


def farthest_points(points: np.ndarray, count: int) -> np.ndarray:
    """Return `count` indices into `points` `[q, 3]`, each the farthest from those before it."""
    chosen = [int(np.argmin(points[:, 1]))]
    distance = np.full(len(points), np.inf)
    for _ in range(count - 1):
        distance = np.minimum(distance, np.square(points - points[chosen[-1]]).sum(axis=1))
        chosen.append(int(distance.argmax()))
    return np.array(chosen)


def seed_transforms(
    seeds: Seeds, scene: Scene, motion: Motion, yaw: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return R_seed `[t, m, 3, 3]` and t_seed `[t, m, 3]`, canonical root frame -> posed root frame.

    The body's own skinning transform at each seed, its rotation made rigid (polar factor): a blend of
    two joints' matrices shears. float32; computed in float64.
    """
    body = scene.body
    rotations = motion.rotations.astype(np.float64)
    positions = joint_positions(rotations, motion.root, body)
    weights, origin = seeds.weights.astype(np.float64), body.joints[0].astype(np.float64)
    blended = np.einsum("mj,tjab->tmab", weights, rotations)
    offset = positions - np.einsum("tjab,jb->tja", rotations, body.joints.astype(np.float64))
    canonical = seeds.points + origin
    posed = np.einsum("tmab,mb->tma", blended, canonical) + np.einsum("mj,tja->tma", weights, offset)
    R = nearest_rotations(blended)
    turn = yaw_matrix(-yaw)[:, None]
    R_root = turn @ R
    posed_root = (turn @ (posed - motion.root[:, None])[..., None])[..., 0]
    t_root = posed_root - np.einsum("tmab,mb->tma", R_root, seeds.points.astype(np.float64))
    return R_root.astype(np.float32), t_root.astype(np.float32)
