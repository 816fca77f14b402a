"""A square cloth and the tables of its collision with a closed surface, for the tests."""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.geometry.laplacian import uniform_table
from garment_jax.geometry.surface_tables import make_surface_tables
from garment_jax.postprocess.collision import (
    CollisionOptions,
    CollisionResult,
    CollisionState,
    CollisionTables,
    initial_state,
    make_collision_tables,
    resolve_collisions,
)
from tests.geometry.surfaces import bumpy

SIDE = 24
PINS = np.array([0, 23, 552, 575], np.int32)  # the sheet's corners
SETTINGS = {"eps": 1e-3, "slack": 0.05, "iterations": 60, "rings": 6}  # of `CollisionOptions`


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


@partial(jax.jit, static_argnames="sizes")
def compiled(V, body, state, pins, pin_positions, settings, sizes):
    """`resolve_collisions` with all but `sizes` traced: tests of several files share one compilation."""
    return resolve_collisions(
        V,
        body,
        state,
        tables=tables()[0],
        pins=pins,
        pin_positions=pin_positions,
        options=CollisionOptions(sizes=sizes)._replace(**settings),
    )


def resolve(
    V: np.ndarray,
    body: np.ndarray | None = None,
    state: CollisionState | None = None,
    *,
    pins: np.ndarray = PINS,
    pin_positions: np.ndarray | None = None,
    sizes: tuple[float, ...] = (),
    **settings: float,
) -> tuple[CollisionResult, CollisionState]:
    """Resolve one frame of the sheet: by default a first one over the bumpy surface, pins where they are.

    Four `pins` are what is compiled; fewer may be named twice.
    """
    made, rest, _ = tables()
    frame, surface = jnp.asarray(V), jnp.asarray(rest if body is None else body)
    begun = initial_state(frame, surface, made.surface) if state is None else state
    positions = frame[pins] if pin_positions is None else jnp.asarray(pin_positions)
    return compiled(frame, surface, begun, jnp.asarray(pins), positions, SETTINGS | settings, sizes)
