"""A dressed scene with as many vertices as a measurement wants: a garment's UV square as a regular grid.

A tube's UVs fill the square (u around from the seam, v from 1 at the top to 0 at the hem), so the grid is
the same garment with more or fewer vertices; what a clip or a model says of the old vertices is carried over.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from garment_jax.structs import Garment, Pins, Scene

INWARD = 1e-6  # of the square: a point on its border lies in a triangle for certain


class Resampled(NamedTuple):
    """A scene with another garment mesh, and how its vertices follow the old ones."""

    scene: Scene
    carry: Callable[[np.ndarray], np.ndarray]  # [..., n_old, 3] -> [..., n, 3]


def grid_shape(vertices: int) -> tuple[int, int]:
    """Return rows and columns of about `vertices` vertices, three times as wide as high."""
    rows = max(round((vertices / 3) ** 0.5), 2)
    return rows, max(round(vertices / rows), 3)


def resample(scene: Scene, rows: int, columns: int) -> Resampled:
    """Return `scene` with a garment of `rows` x `columns` vertices, joined along its seam.

    Raises `ValueError` where the garment's UVs leave a grid point uncovered.
    """
    garment = scene.garment
    u, v = np.meshgrid(np.arange(columns + 1) / columns, 1 - np.arange(rows) / (rows - 1))
    uv = np.stack([u, v], axis=-1).reshape(-1, 2)
    own = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    index, weight = _located(garment, uv[own])

    def carry(V: np.ndarray) -> np.ndarray:
        return np.einsum("nk,...nkc->...nc", weight, V[..., index, :]).astype(np.float32)

    faces, faces_uv = _grid_faces(rows, columns, columns), _grid_faces(rows, columns, columns + 1)
    grid = Garment(carry(garment.template), faces, uv.astype(np.float32), faces_uv)
    return Resampled(scene._replace(garment=grid, pins=_pins(scene, index, weight)), carry)


def _located(garment: Garment, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the garment's vertices `[n, 3]` around UV `points` and their barycentric weights."""
    from matplotlib.tri import Triangulation

    uv = garment.uv.astype(np.float64)
    inside = np.clip(points, INWARD, 1 - INWARD)
    face = Triangulation(*uv.T, garment.faces_uv).get_trifinder()(*inside.T)
    if (face < 0).any():
        raise ValueError(
            f"{(face < 0).sum()} of {len(points)} grid points lie outside the garment's UVs; "
            "take a garment whose UVs fill the unit square, such as a skirt's."
        )
    a, b, c = np.moveaxis(uv[garment.faces_uv[face]], 1, 0)
    x, y = np.linalg.solve(np.stack([b - a, c - a], axis=-1), (inside - a)[..., None])[..., 0].T
    return garment.faces[face], np.stack([1 - x - y, x, y], axis=-1)


def _grid_faces(rows: int, columns: int, stride: int) -> np.ndarray:
    """Return two triangles a cell; column `columns` is column 0 again where the stride leaves it out."""
    r, c = (x.ravel() for x in np.mgrid[: rows - 1, :columns])
    a, b, d, e = ((r + dr) * stride + (c + dc) % stride for dr, dc in ((0, 0), (1, 0), (0, 1), (1, 1)))
    return (
        np.stack([np.stack([a, b, d], -1), np.stack([d, b, e], -1)], axis=1).reshape(-1, 3).astype(np.int32)
    )


def _pins(scene: Scene, index: np.ndarray, weight: np.ndarray) -> Pins | None:
    """Return the vertices that lie among the old pins alone, with their skinning weights mixed."""
    if scene.pins is None:
        return None
    old = np.zeros((len(scene.garment.template), scene.pins.weights.shape[1]))
    old[scene.pins.vertices] = scene.pins.weights
    mixed = np.einsum("nk,nkj->nj", weight, old[index])
    pinned = np.flatnonzero(mixed.sum(axis=1) > 1 - 1e-3)
    weights = mixed[pinned] / mixed[pinned].sum(axis=1, keepdims=True)
    return Pins(pinned.astype(np.int32), weights.astype(np.float32))
