"""A garment without its short waves: its coordinates in the lowest modes of the template's Laplacian.

What is affine in the template stays as it is, so that borders are not drawn inwards, as they are where
smoothing is diffusion. Costs two products with a matrix of some hundred columns.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float, Int
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import eigsh

from garment_jax.geometry.laplacian import cotangents

LEAST = 1e-2  # gain below which a mode is left out
DENSE = 300  # vertices up to which all modes are computed


class LowPassTables(NamedTuple):
    """What does not change from frame to frame (static)."""

    modes: np.ndarray  # [n, k] float32, orthonormal by `mass`
    gains: np.ndarray  # [r, k] float32, of each reach
    affine: np.ndarray  # [n, a] float32, orthonormal by `mass`: what stays
    mass: np.ndarray  # [n] float32, each vertex' area, the sum 1


def make_low_pass(
    template: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], reaches: tuple[float, ...]
) -> LowPassTables:
    """Return the tables of a garment with at least one face; `template` and `reaches` in metres.

    A wave of length 2 pi times the reach keeps 78 % of its height, one of half that length 2 %.
    """
    T, n = np.asarray(template, np.float64), len(template)
    corners = T[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    mass = np.bincount(faces.ravel(), np.repeat(area / 3, 3), n)
    mass = np.maximum(mass, 1e-6 * mass.mean())  # no zero for a vertex without a face
    highest = 2 * np.sqrt(-np.log(LEAST)) / min(reaches) ** 2
    values, modes = _lowest(cotangents(T, faces), mass, highest)
    gains = np.stack([np.exp(-((values * reach**2 / 2) ** 2)) for reach in reaches])
    scaled = np.sqrt(mass)[:, None] * np.column_stack([np.ones(n), T - T.mean(axis=0)])
    left, size, _ = np.linalg.svd(scaled, full_matrices=False)
    affine = left[:, size > 1e-6 * size[0]] / np.sqrt(mass)[:, None]
    total = mass.sum()
    return LowPassTables(
        (modes * np.sqrt(total)).astype(np.float32),
        gains.astype(np.float32),
        (affine * np.sqrt(total)).astype(np.float32),
        (mass / total).astype(np.float32),
    )


def _lowest(weights: csr_matrix, mass: np.ndarray, highest: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the eigenvalues (1/m^2) up to `highest` and their modes `[n, k]`, of a mesh' edge weights."""
    n = len(mass)
    stiffness = (diags(np.asarray(weights.sum(axis=1)).ravel()) - weights).tocsc()
    if n <= DENSE:
        values, modes = scipy.linalg.eigh(stiffness.toarray(), np.diag(mass))
    else:
        start = np.random.default_rng(0).normal(size=n)  # the same modes every time
        k = int(mass.sum() * highest / (4 * np.pi)) + 20  # Weyl's law, and borders
        while True:
            k = min(k, n - 2)
            values, modes = eigsh(stiffness, k=k, M=diags(mass).tocsc(), sigma=-1.0, v0=start)
            if values.max() > highest or k == n - 2:
                break
            k *= 2
    low = values <= highest
    return np.maximum(values[low], 0.0), modes[:, low]


def low_pass(V: Float[Array, "n 3"], tables: LowPassTables) -> tuple[Float[Array, "n 3"], ...]:
    """Return `V` (metres) without short waves, once for each reach."""
    mass = jnp.asarray(tables.mass)[:, None]
    affine, modes = jnp.asarray(tables.affine), jnp.asarray(tables.modes)
    flat = affine @ (affine.T @ (mass * V))
    amounts = modes.T @ (mass * (V - flat))
    waves = modes @ jnp.concatenate([gain[:, None] * amounts for gain in jnp.asarray(tables.gains)], axis=1)
    return tuple(flat + part for part in jnp.split(waves, len(tables.gains), axis=1))
