"""Joint positions with which a rigged body's skinned vertices come closest to a sequence (host, float64)."""

import numpy as np

from garment_jax.body.pose_fit import subtree_weights
from garment_jax.structs import RiggedBody

_PULL = 1e-4  # towards the joints as they are, beside mean squared differences of rotations


def fit_joints(body: RiggedBody, frames: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Return rest positions `[j, 3]` float64 for `frames` `[t, b, 3]` under rotations `R` `[t, j, 3, 3]`.

    Moving joint k by d moves a vertex by W (R_parent - R_k) d, W its weight of k and all below: linear in
    the joints, the root's position of each frame eliminated. Joint 0 only names a place and stays, and so
    does a joint along a direction that the motion leaves open.
    """
    joints, rest = body.joints.astype(np.float64), body.vertices.astype(np.float64)
    weights = body.skin_weights.astype(np.float64)
    if len(joints) == 1:
        return joints
    below = subtree_weights(weights, body.parents)[:, 1:]
    below = below - below.mean(axis=0)
    B = R[:, body.parents[1:]] - R[:, 1:]
    flat = B.transpose(0, 2, 1, 3).reshape(len(R), 3, -1)
    A = np.einsum("tca,tcb->ab", flat, flat) * np.repeat(np.repeat(below.T @ below, 3, axis=0), 3, axis=1)
    # What the vertices still miss with the joints where they are.
    u = (weights[:, :, None] * rest[:, None]).reshape(len(rest), -1)
    turned = R.transpose(0, 2, 1, 3).reshape(len(R), 3, -1)
    left = below.T @ frames.astype(np.float64) - (turned @ (u.T @ below)).transpose(0, 2, 1)
    left -= (below.T @ below) @ np.einsum("tkca,ka->tkc", B, joints[1:])
    miss = np.einsum("tkca,tkc->ka", B, left).ravel()
    pull = _PULL * len(R) * np.repeat(np.maximum(np.square(below).sum(axis=0), 1e-9), 3)
    step = np.linalg.solve(A + np.diag(pull), miss)
    return joints + np.concatenate([np.zeros((1, 3)), step.reshape(-1, 3)])
