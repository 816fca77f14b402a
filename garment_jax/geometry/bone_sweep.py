"""Transforms of bones under known weights, one bone after the other (Le & Deng 2012, section 4.3; host).

From sums over vertices that are made once, so that a sweep's cost does not depend on the mesh.
"""

from typing import NamedTuple

import numpy as np

from garment_jax.geometry.bone_errors import homogeneous
from garment_jax.geometry.rigid_fit import nearest_rotations, towards


class BoneSystem(NamedTuple):
    """The error as a function of the transforms M `[t, 3, 4 b]`: square - 2 <M, D> + <M Y, M>."""

    Y: np.ndarray  # [4 b, 4 b] sums over vertices of weighted rest positions
    D: np.ndarray  # [t, 3, 4 b] sums over vertices of where they went
    square: np.ndarray  # [t] sums of squares


def bone_system(rest: np.ndarray, weights: np.ndarray, V: np.ndarray) -> BoneSystem:
    """Return the sums over vertices for frames `V` `[t, n, 3]` float64 under `weights` `[n, b]`."""
    y = (weights[:, :, None] * homogeneous(rest)[:, None]).reshape(len(rest), -1)
    return BoneSystem(y.T @ y, V.transpose(0, 2, 1) @ y, np.einsum("tnc,tnc->t", V, V))


def squared_error(system: BoneSystem, R: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Return the sum over vertices of the squared distance, `[t]`."""
    M = joined(R, T)
    return np.maximum(system.square + (M * (M @ system.Y - 2 * system.D)).sum(axis=(1, 2)), 0.0)


def rmse_of(system: BoneSystem, R: np.ndarray, T: np.ndarray, n: int) -> float:
    """Return the root mean squared distance of a vertex over all frames."""
    return float(np.sqrt(squared_error(system, R, T).mean() / n))


def sweep(system: BoneSystem, R: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solve for each bone's transform in turn, the others fixed (paper, section 4.3; closed form).

    A bone without weight keeps its transform. Never raises the error.
    """
    M, R, T = joined(R, T), R.copy(), T.copy()
    for j in range(R.shape[1]):
        own = slice(4 * j, 4 * j + 4)
        block = system.Y[own, own]
        mass = block[3, 3]
        if mass < 1e-10:
            continue
        left = system.D[:, :, own] - M @ system.Y[:, own] + M[:, :, own] @ block
        centre, arrived = block[:3, 3] / mass, left[:, :, 3] / mass
        C = left[:, :, :3] - arrived[:, :, None] * block[3, :3]
        spread = np.trace(block[:3, :3]) - mass * centre @ centre
        R[:, j] = nearest_rotations(towards(C, np.full(len(C), max(spread, 0.0)), R[:, j]))
        T[:, j] = arrived - R[:, j] @ centre
        M[:, :, own] = joined(R[:, j : j + 1], T[:, j : j + 1])
    return R, T


def joined(R: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Return the bones' (R, T) side by side, `[t, 3, 4 b]`."""
    M = np.concatenate([R, T[..., None]], axis=3)
    return M.transpose(0, 2, 1, 3).reshape(len(R), 3, -1)
