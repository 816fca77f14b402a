"""The mesh Laplacian of the template, one convention everywhere.

Sign and scale: (laplacian V)_i = sum_j w_ij (v_j - v_i) with rows of w summing to 1. It points
from a vertex towards the weighted mean of its one-ring, is zero on a flat regular mesh, and its
null space holds the constant meshes (a translation changes nothing).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float
from scipy.sparse import csr_matrix

from garment_jax.geometry.stencil import Stencil, apply_stencil, make_stencil
from garment_jax.geometry.topology import neighbour_table


class LaplacianTable(NamedTuple):
    """Padded stencil of the template's Laplacian (static)."""

    index: np.ndarray  # [n, k] int32 one-ring, padded with the vertex itself
    weight: np.ndarray  # [n, k] float32, rows sum to 1 (0 for a vertex without neighbours)
    stencil: Stencil  # the whole operator, the vertex' own -1 in its last column


def _table(index: np.ndarray, weight: np.ndarray) -> LaplacianTable:
    n = len(index)
    own = np.arange(n, dtype=np.int32)[:, None]
    minus = -weight.sum(axis=1, keepdims=True)
    whole = np.concatenate([weight, minus], axis=1)
    stencil = make_stencil(np.concatenate([index, own], axis=1), whole, n)
    return LaplacianTable(index, weight.astype(np.float32), stencil)


def uniform_table(faces: np.ndarray, n: int) -> LaplacianTable:
    """Return the uniform stencil: each neighbour weighs 1 / valence."""
    index, mask = neighbour_table(faces, n)
    return _table(index, mask / np.maximum(mask.sum(axis=1, keepdims=True), 1.0))


def cotangents(template: np.ndarray, faces: np.ndarray) -> csr_matrix:
    """Return the cotangent weight of every edge of `template` `[n, 3]`, `[n, n]` and symmetric.

    Negative weights of obtuse triangles would turn the smoothing into sharpening, and a
    triangle without area has no cotangent: both are clamped to [1e-6, 1e3].
    """
    P, rows, columns, weights = template.astype(np.float64), [], [], []
    for corner in range(3):
        o, a, b = faces[:, corner], faces[:, (corner + 1) % 3], faces[:, (corner + 2) % 3]
        u, v = P[a] - P[o], P[b] - P[o]
        area = np.linalg.norm(np.cross(u, v), axis=1)
        cot = np.clip((u * v).sum(1) / np.maximum(area, 1e-12), 1e-6, 1e3) / 2
        rows += [a, b]
        columns += [b, a]
        weights += [cot, cot]
    places = np.concatenate(rows), np.concatenate(columns)
    return csr_matrix((np.concatenate(weights), places), (len(template),) * 2)


def cotangent_table(template: np.ndarray, faces: np.ndarray) -> LaplacianTable:
    """Return the cotangent stencil of `template` `[n, 3]`, rows normalised."""
    n = len(template)
    index, mask = neighbour_table(faces, n)
    own = np.repeat(np.arange(n), index.shape[1])
    weight = np.asarray(cotangents(template, faces)[own, index.ravel()]).reshape(index.shape) * mask
    total = np.maximum(weight.sum(axis=1, keepdims=True), 1e-12)
    return _table(index, weight / total)


def laplacian(V: Float[Array, "*b n 3"], table: LaplacianTable) -> Float[Array, "*b n 3"]:
    """Return the Laplacian of `V`, in V's unit (see the module's convention)."""
    return apply_stencil(V, table.stencil)
