"""A square cloth and the tables of its collision with a closed surface, for the tests."""

from functools import lru_cache

import numpy as np

from garment_jax.geometry.laplacian import uniform_table
from garment_jax.geometry.surface_tables import make_surface_tables
from garment_jax.postprocess.collision import CollisionTables, make_collision_tables
from tests.geometry.surfaces import bumpy

SIDE = 24


def sheet(height: float = 0.2, width: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return a horizontal square grid `[SIDE^2, 3]` (metres) at `height` and its faces."""
    x = np.linspace(-width / 2, width / 2, SIDE)
    grid = np.stack(np.meshgrid(x, [height], x, indexing="ij"), axis=-1).reshape(-1, 3)
    index = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return grid.astype(np.float32), faces.astype(np.int32)


@lru_cache
def tables() -> tuple[CollisionTables, np.ndarray, np.ndarray]:
    """Return the tables of the sheet over the bumpy surface, and that surface's vertices and faces."""
    vertices, faces = bumpy()
    V, sheet_faces = sheet()
    stencil = uniform_table(sheet_faces, len(V))
    made = make_collision_tables(V, stencil, make_surface_tables(vertices, faces))
    return made, vertices.astype(np.float32), faces
