"""Which joints are the trunk's, and how much of a vertex hangs on them (host, once per body)."""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float

from garment_jax.body.joint_names import roles_of
from garment_jax.body.limbs import LIMB, SHORTEST, joints_before_forks
from garment_jax.geometry.topology import unique_edges
from garment_jax.structs import RiggedBody

_ARMS, _LEGS = ("LeftArm", "RightArm"), ("LeftUpLeg", "RightUpLeg")
_COLLAR = 0.02  # of the body's height: how wide the trunk's end is at the neck's joint
_SMOOTHINGS = 3
_LIMBS = (4, 5)  # arms and legs, with or without a neck that is long enough to count


def trunk_share(body: RiggedBody) -> Float[np.ndarray, " b"] | None:
    """Return how far every vertex belongs to the trunk, 0 to 1; None where the trunk is unknown.

    The sum of its skin weights on the trunk's joints, 0 above the neck's joint (bone heat lets the chest
    reach up to the chin), averaged over neighbours (painted weights jump).
    """
    trunk = trunk_joints(body)
    if trunk is None:
        return None
    share = np.asarray(body.skin_weights, np.float64)[:, trunk].sum(axis=1)
    neck = roles_of(body.joint_names, body.parents).get("Neck")
    if neck is not None:
        x, joints = body.vertices.astype(np.float64), body.joints.astype(np.float64)
        up = joints[neck] - joints[body.parents[neck]]
        above = (x - joints[neck]) @ up / max(float(np.linalg.norm(up) * np.ptp(x, axis=0).max()), 1e-12)
        share = share * np.clip(0.5 - above / _COLLAR, 0.0, 1.0)
    return _smoothed(share, body)


def _smoothed(values: np.ndarray, body: RiggedBody) -> np.ndarray:
    """Return `[b]` values averaged with their neighbours' a few times; vertices at one place are one."""
    _, first, place = np.unique(body.vertices, axis=0, return_index=True, return_inverse=True)
    place, n = place.ravel(), len(first)
    edges = place[unique_edges(np.asarray(body.faces))]
    ring = sp.csr_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), (n, n))
    ring = sp.csr_matrix(ring + ring.T + sp.eye(n))
    ring.data[:] = 1  # what lies at one place may share an edge twice
    mean, found = sp.diags(1 / np.asarray(ring.sum(axis=1)).ravel()) @ ring, values[first]
    for _ in range(_SMOOTHINGS):
        found = mean @ found
    return found[place]


def trunk_joints(body: RiggedBody) -> Bool[np.ndarray, " j"] | None:
    """Return which joints are the trunk's: hips, spine and what hangs on them but for neck, arms and legs.

    By the joints' names; where these are unknown by the hierarchy, whose last fork of limbs ends the trunk.
    None where neither tells a human's trunk. Collar bones belong to the arms.
    """
    roles = roles_of(body.joint_names, body.parents)
    if {"Hips", "Neck", *_ARMS, *_LEGS} <= roles.keys():
        return _trunk_by_names(roles, np.asarray(body.parents))
    return _trunk_by_forks(body)


def _trunk_by_names(roles: dict[str, int], parents: np.ndarray) -> np.ndarray:
    ends = [roles[role] for role in ("Neck", *_ARMS, *_LEGS)]
    count = np.zeros(len(parents), int)  # of the neck, arms and legs that hang on a joint, itself included
    count[ends] = 1
    for j in range(len(parents) - 1, 0, -1):
        count[parents[j]] += count[j]
    trunk = np.ones(len(parents), bool)
    trunk[ends] = False
    for k in (roles[role] for role in _ARMS):  # with the collar bone, whatever it is called
        while k > 0 and count[parents[k]] == 1:
            k = int(parents[k])
            trunk[k] = False
    for j in range(1, len(parents)):
        trunk[j] &= trunk[parents[j]]
    return trunk


def _trunk_by_forks(body: RiggedBody) -> np.ndarray | None:
    joints, parents = body.joints.astype(np.float64), np.asarray(body.parents)
    height = float(np.ptp(body.vertices.astype(np.float64), axis=0).max())
    trunk = joints_before_forks(joints, parents, height)
    way, top = np.zeros(len(joints)), joints[:, 1].copy()  # metres from the parent to the farthest tip below
    for j in range(len(joints) - 1, 0, -1):
        p = int(parents[j])
        way[j] += np.linalg.norm(joints[j] - joints[p])
        way[p], top[p] = max(way[p], way[j]), max(top[p], top[j])
    limbs = [
        j for j in range(1, len(joints)) if trunk[parents[j]] and not trunk[j] and way[j] >= LIMB * height
    ]
    if len(limbs) not in _LIMBS:
        return None
    neck = joints[trunk, 1].max() + SHORTEST * height
    for j in range(1, len(joints)):  # a breast is the trunk's, a head is not
        trunk[j] |= trunk[parents[j]] and way[j] < LIMB * height and top[j] < neck
    return trunk
