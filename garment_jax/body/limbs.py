"""The limbs that cloth can hang around: arms and legs as bones with a thickness (host, once per scene)."""

from typing import NamedTuple

import numpy as np

from garment_jax.body.kinematics import collider_points
from garment_jax.geometry.winding_number import winding_number
from garment_jax.structs import Collider, RiggedBody

LIMB = 0.25  # metres from a fork to a tip: what is shorter, as a finger, is no limb of its own
SHORTEST = 0.05  # metres of a bone that has a thickness


class Limbs(NamedTuple):
    """The bones of a body's limbs, those inside its collider (static)."""

    joints: np.ndarray  # [q, 2] int32 the joints at a bone's ends, from the trunk outward
    radius: np.ndarray  # [q] metres: median distance of the surface from the bone


def limbs_of(body: RiggedBody, collider: Collider) -> Limbs:
    """Return the limbs of `body` whose bones lie inside `collider` on the canonical body.

    A limb begins where the trunk ends: behind the last joint at which at least two chains of `LIMB` or
    more part. Bones without surface of their own around them are left out.
    """
    joints, parents = body.joints.astype(np.float64), np.asarray(body.parents)
    surface = collider_points(collider, body.vertices.astype(np.float64))
    inside = winding_number(joints, surface, collider.faces) > 0.5
    trunk = _trunk(joints, parents)
    weights = body.skin_weights[collider.body_vertices]
    found: list[tuple[int, int, float]] = []
    for j in range(1, len(joints)):
        p = int(parents[j])
        if trunk[p] or not (inside[p] and inside[j]):
            continue
        around = surface[: len(weights)][weights[:, p] > 0.5]
        radius = _radius(around, joints[p], joints[j])
        if radius is not None:
            found.append((p, j, radius))
    if not found:
        return Limbs(np.zeros((0, 2), np.int32), np.zeros(0))
    starts, ends, radius = zip(*found, strict=True)
    return Limbs(np.stack([starts, ends], axis=1).astype(np.int32), np.array(radius))


def _trunk(joints: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """Return which joints are part of the trunk: those at or before a fork of limbs, `[j]`."""
    n = len(joints)
    reach, long = np.zeros(n), np.zeros(n, int)  # metres to the farthest tip; chains that are limbs
    for j in range(n - 1, 0, -1):
        p = int(parents[j])
        length = reach[j] + float(np.linalg.norm(joints[j] - joints[p]))
        reach[p], long[p] = max(reach[p], length), long[p] + (length >= LIMB)
    trunk = long > 1
    for j in range(n - 1, 0, -1):
        trunk[parents[j]] |= trunk[j]
    return trunk


def _radius(around: np.ndarray, a: np.ndarray, b: np.ndarray) -> float | None:
    """Return the median distance of the points `[k, 3]` beside the bone from it, None without any."""
    axis = b - a
    square = float(axis @ axis)
    if square < SHORTEST**2:
        return None
    along = (around - a) @ axis / square
    beside = (along > 0.1) & (along < 0.9)
    if not beside.any():
        return None
    away = around[beside] - a - along[beside, None] * axis
    return float(np.median(np.linalg.norm(away, axis=1)))
