"""The air's drag on a cloth: quadratic in the speed across each face, by hand before each solver step.

At 0.2 kg/m2 a fold that moves at 1.6 m/s across itself feels a drag as large as its weight; the solver
has none of its own.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from garment_jax.simulation.settings import ClothSettings


class Air(NamedTuple):
    """What the drag needs of a cloth (static)."""

    corners: np.ndarray  # [3, f] int64
    share: sp.csr_matrix  # [n, f] part of a vertex's mass that a face gave it; rows sum to 1
    weight: np.ndarray  # [f] float32, 1/2 rho c_d / (mass of the face), 1/(m s) per m2 and m/s


def make_air(faces: np.ndarray, areas: np.ndarray, n: int, settings: ClothSettings) -> Air:
    """Return the tables for `n` vertices and `faces` `[f, 3]` of rest `areas` `[f]` (m2)."""
    air_density = settings.air_density if settings.air else 0.0
    third = np.repeat(areas / 3.0, 3)
    columns = np.repeat(np.arange(len(faces)), 3)
    share = sp.csr_matrix((third, (faces.ravel(), columns)), (n, len(faces)), dtype=np.float64)
    total = np.asarray(share.sum(axis=1)).ravel()
    share = sp.diags(1.0 / np.where(total > 0, total, 1.0)) @ share  # a vertex without faces feels no air
    weight = 0.5 * air_density * settings.drag / (settings.density * areas)
    corners = np.ascontiguousarray(faces.T, np.int64)
    return Air(corners, sp.csr_matrix(share, dtype=np.float32), weight.astype(np.float32))


def drag_velocities(air: Air, x: np.ndarray, v: np.ndarray, dt: float) -> np.ndarray:
    """Return the change of the velocities `v` `[n, 3]` (m/s) at positions `x` (metres) in `dt` seconds.

    A face feels 1/2 rho c_d A |w| w along its normal, w being the speed of its centre along it. The
    change is limited to w itself: too long a step stops a face but never sends it back. Vertices take
    the mean of their faces' changes by mass. A face without area feels nothing.
    """
    i, j, k = air.corners
    a, centre = x[i], (v[i] + v[j] + v[k]) / np.float32(3.0)
    normal = _cross(x[j] - a, x[k] - a)
    length = np.sqrt(np.einsum("fa,fa->f", normal, normal))
    normal /= np.maximum(length, np.float32(1e-20))[:, None]
    w = np.einsum("fa,fa->f", centre, normal)
    stopped = np.minimum(air.weight * (0.5 * dt) * length * np.abs(w), 1.0)
    return air.share @ (normal * (-stopped * w)[:, None])


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """np.cross takes five times as long for many small vectors."""
    (a0, a1, a2), (b0, b1, b2) = a.T, b.T
    return np.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], axis=1)
