"""The limbs that cloth can hang around: arms and legs as bones with a thickness (host, once per scene)."""

from typing import NamedTuple

import numpy as np

from garment_jax.body.kinematics import collider_points
from garment_jax.geometry.winding_number import winding_number
from garment_jax.structs import Collider, RiggedBody

LIMB = 0.14  # of the body's height, from a fork to a tip: what is shorter, as a finger, is no limb of its own
SHORTEST = 0.028  # of the body's height: a bone that has a thickness


class Limbs(NamedTuple):
    """The bones of a body's limbs, those inside its collider (static)."""

    joints: np.ndarray  # [q, 2] int32 the joints at a bone's ends, from the trunk outward
    radius: np.ndarray  # [q] metres: median distance of the surface from the bone


def limbs_of(body: RiggedBody, collider: Collider) -> Limbs:
    """Return the limbs of `body` whose bones lie inside `collider` on the canonical body.

    A limb begins where the trunk ends: behind the last joint at which at least two chains of `LIMB` or
    more part. Bones without surface of their own around them are left out, and joints that end beside
    another bone of their parent's, as those that carry a twist.
    """
    joints, parents = body.joints.astype(np.float64), np.asarray(body.parents)
    height = float(np.ptp(body.vertices.astype(np.float64), axis=0).max())
    beside = _beside(joints, parents, SHORTEST * height)
    trunk = joints_before_forks(joints, parents, height)
    surface = collider_points(collider, body.vertices.astype(np.float64))
    inside = winding_number(joints, surface, collider.faces) > 0.5
    weights = body.skin_weights[collider.body_vertices]
    found: list[tuple[int, int, float]] = []
    for j in range(1, len(joints)):
        p = int(parents[j])
        if trunk[p] or beside[j] or not (inside[p] and inside[j]):
            continue
        around = surface[: len(weights)][weights[:, p] > 0.5]
        radius = _radius(around, joints[p], joints[j], SHORTEST * height)
        if radius is not None:
            found.append((p, j, radius))
    if not found:
        return Limbs(np.zeros((0, 2), np.int32), np.zeros(0))
    starts, ends, radius = zip(*found, strict=True)
    return Limbs(np.stack([starts, ends], axis=1).astype(np.int32), np.array(radius))


def _beside(joints: np.ndarray, parents: np.ndarray, near: float) -> np.ndarray:
    """Return which childless joints lie within `near` metres of another bone of their parent's, `[j]`."""
    n = len(joints)
    found = np.zeros(n, bool)
    for j in sorted(set(range(1, n)) - set(parents.tolist())):
        p = int(parents[j])
        for other in np.flatnonzero(parents == p):
            if other in (0, j) or found[other]:
                continue
            axis = joints[other] - joints[p]
            t = np.clip((joints[j] - joints[p]) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
            found[j] |= float(np.linalg.norm(joints[j] - joints[p] - t * axis)) < near
    return found


def joints_before_forks(joints: np.ndarray, parents: np.ndarray, height: float) -> np.ndarray:
    """Return which joints are at or before a fork of limbs, `[j]`: the trunk's.

    `joints` `[j, 3]` and `height` of the body in metres. A limb is at least `LIMB` of the height long; joints
    beside another bone of their parent's are none.
    """
    beside = _beside(joints, parents, SHORTEST * height)
    n = len(joints)
    reach, long = np.zeros(n), np.zeros(n, int)  # metres to the farthest tip; chains that are limbs
    for j in (j for j in range(n - 1, 0, -1) if not beside[j]):
        p = int(parents[j])
        length = reach[j] + float(np.linalg.norm(joints[j] - joints[p]))
        reach[p], long[p] = max(reach[p], length), long[p] + (length >= LIMB * height)
    trunk = long > 1
    for j in range(n - 1, 0, -1):
        trunk[parents[j]] |= trunk[j]
    return trunk


def _radius(around: np.ndarray, a: np.ndarray, b: np.ndarray, shortest: float) -> float | None:
    """Return the median distance of the points `[k, 3]` beside the bone from it, None without any.

    None, too, for a bone of less than `shortest` metres.
    """
    axis = b - a
    square = float(axis @ axis)
    if square < shortest**2:
        return None
    along = (around - a) @ axis / square
    beside = (along > 0.1) & (along < 0.9)
    if not beside.any():
        return None
    away = around[beside] - a - along[beside, None] * axis
    return float(np.median(np.linalg.norm(away, axis=1)))
