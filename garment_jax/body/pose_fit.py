"""The rotations with which a rigged body comes closest to a sequence of its vertices (host, NumPy, float64).

Under forward kinematics a skinned vertex is root + sum_j R_j u_ij: what hangs below joint j moves with it,
so u_ij collects the weights of the whole subtree and does not change from frame to frame. One joint's best
rotation, the others fixed, is then a Procrustes problem in sums over vertices.
"""

from typing import NamedTuple

import numpy as np

from garment_jax.geometry.rigid_fit import nearest_rotations, rigid_transforms, towards
from garment_jax.structs import RiggedBody

SWEEPS = 60
_STILL = 1e-4  # of the error: a sweep that lowers it by less is the last


class PoseTerms(NamedTuple):
    """A rigged body's constants of the fit, the root's position eliminated."""

    u: np.ndarray  # [n, 3 j] what joint j's rotation carries, less its mean over vertices
    mean: np.ndarray  # [3 j] that mean
    U: np.ndarray  # [3 j, 3 j] sums over vertices


def subtree_weights(weights: np.ndarray, parents: np.ndarray) -> np.ndarray:
    """Return for each vertex and joint the weight of the joint and all below it, `[n, j]` float64."""
    total = weights.astype(np.float64)
    for k in range(len(parents) - 1, 0, -1):
        total[:, parents[k]] += total[:, k]
    return total


def pose_terms(body: RiggedBody) -> PoseTerms:
    """Return the constants of `body`; parents come before their children."""
    rest, joints = body.vertices.astype(np.float64), body.joints.astype(np.float64)
    below = subtree_weights(body.skin_weights, body.parents)
    u = body.skin_weights[:, :, None] * (rest[:, None] - joints)
    for k in range(1, len(joints)):
        parent = body.parents[k]
        u[:, parent] += below[:, k, None] * (joints[k] - joints[parent])
    flat = u.reshape(len(rest), -1)
    mean = flat.mean(axis=0)
    flat = flat - mean
    return PoseTerms(flat, mean, flat.T @ flat)


def fit_pose(
    body: RiggedBody,
    frames: np.ndarray,
    *,
    terms: PoseTerms | None = None,
    start: np.ndarray | None = None,
    sweeps: int = SWEEPS,
) -> tuple[np.ndarray, np.ndarray]:
    """Return world rotations `[t, j, 3, 3]` and root positions `[t, 3]` that bring `body` to `frames`.

    `frames` `[t, b, 3]` are world metres in the body's vertex order; `start` `[t, j, 3, 3]` where to begin
    (each joint's own best without it). Least squares over vertices; frames do not know of each other. The
    error never rises, and a joint that the vertices do not tell keeps its parent's turn.
    """
    terms = pose_terms(body) if terms is None else terms
    V = frames.astype(np.float64)
    middle = V.mean(axis=1)
    V = V - middle[:, None]
    R = _begin(body, V) if start is None else start.astype(np.float64)
    D = V.transpose(0, 2, 1) @ terms.u
    before = np.inf
    for _ in range(sweeps):
        R = _sweep(terms.U, D, R)
        flat = _flat(R)
        now = float(np.square(V).sum() + (flat * (flat @ terms.U - 2 * D)).sum())
        if before - now <= _STILL * now:
            break
        before = now
    return R, middle - _flat(R) @ terms.mean


def _begin(body: RiggedBody, V: np.ndarray) -> np.ndarray:
    """Return each joint's rotation as its own vertices tell it; parents decide what these leave open."""
    rest = body.vertices.astype(np.float64)
    weights = body.skin_weights.astype(np.float64)
    whole, _ = rigid_transforms(rest, V, np.ones((len(rest), 1)))
    R = np.repeat(whole, weights.shape[1], axis=1)
    for j, parent in enumerate(body.parents):
        known = whole[:, 0] if parent < 0 else R[:, parent]
        R[:, j] = rigid_transforms(rest, V, weights[:, j : j + 1], known)[0][:, 0]
    return R


def _sweep(U: np.ndarray, D: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Solve for each joint's rotation in turn, the others fixed; `D` `[t, 3, 3 j]`."""
    R, flat = R.copy(), _flat(R)
    for j in range(R.shape[1]):
        own = slice(3 * j, 3 * j + 3)
        left = D[:, :, own] - flat @ U[:, own] + flat[:, :, own] @ U[own, own]
        spread = np.full(len(R), np.trace(U[own, own]))
        R[:, j] = nearest_rotations(towards(left, spread, R[:, j]))
        flat[:, :, own] = R[:, j]
    return R


def _flat(R: np.ndarray) -> np.ndarray:
    """Return rotations `[t, j, 3, 3]` side by side, `[t, 3, 3 j]`."""
    return R.transpose(0, 2, 1, 3).reshape(len(R), 3, -1)
