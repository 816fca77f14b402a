from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.geometry.gather import coordinates_of
from garment_jax.geometry.laplacian import uniform_table
from garment_jax.geometry.surface_search import pose_surface
from garment_jax.geometry.surface_tables import make_surface_tables
from garment_jax.postprocess.collision import CollisionTables, make_collision_tables
from garment_jax.postprocess.collision.contacts import (
    crossing_limit,
    find_again,
    find_contacts,
)
from garment_jax.postprocess.collision.projection import initial_state
from tests.geometry.surfaces import brute_signed, sphere
from tests.postprocess.collision.cloth import SIDE, sheet, tables

RADIUS = 0.3


@lru_cache
def over_a_ball() -> tuple[CollisionTables, np.ndarray, np.ndarray]:
    """Return the tables of a sheet and a ball of small parts, the sheet and the ball's vertices."""
    vertices, faces = sphere(RADIUS, 5)
    V, sheet_faces = sheet(width=0.4)
    made = make_collision_tables(V, uniform_table(sheet_faces, len(V)), make_surface_tables(vertices, faces))
    return made, V, vertices.astype(np.float32)


@jax.jit
def limits(V, body, state):
    made = over_a_ball()[0]
    surface = pose_surface(body, made.surface)
    local = V.T - surface.origin[:, None]
    grouped = coordinates_of(made.groups.T, local.reshape(-1))
    return crossing_limit(grouped, V.T - state.V, body.T - state.collider, surface, made)


@jax.jit
def found(V, body, last, limit):
    made = tables()[0]
    surface = pose_surface(body, made.surface)
    local = V.T - surface.origin[:, None]
    return find_contacts(
        local, coordinates_of(made.groups.T, local.reshape(-1)), last, limit, surface, made
    ), surface.origin


@jax.jit
def again(V, body, at, limit):
    made = tables()[0]
    surface = pose_surface(body, made.surface)
    return find_again(V.T - surface.origin[:, None], at, limit, surface, made)


@pytest.mark.parametrize("farther", [0.0, 0.6])  # so far that no box of cloth and ball met before
@pytest.mark.parametrize("seed", range(8))
def test_whatever_came_in_is_within_its_limit(seed: int, farther: float):
    made, V, ball = over_a_ball()
    rng = np.random.default_rng(seed)
    before = V + np.array([0.0, rng.uniform(0.05, 0.15), 0.0])
    before[:, 1] += farther
    ways = rng.normal(scale=0.05, size=(2, 3)) + [
        [0.0, -0.1 - farther / 2, 0.0],
        [0.0, 0.05 + farther / 2, 0.0],
    ]
    after, there = before + ways[0] + rng.normal(scale=1e-3, size=V.shape), ball + ways[1]
    came_in = np.linalg.norm(before, axis=1) > RADIUS
    depth = RADIUS - np.linalg.norm(after - ways[1], axis=1)
    came_in &= depth > 0
    assert came_in.sum() > 10  # or the test says nothing
    state = initial_state(*(jnp.asarray(x, jnp.float32) for x in (before, ball)), made.surface)
    limit = np.asarray(limits(*(jnp.asarray(x, jnp.float32) for x in (after, there)), state))
    assert (limit[came_in] > depth[came_in] - 1e-3).all()  # a ball of triangles is that much smaller


def test_what_slides_along_the_body_or_leaves_it_need_not_be_searched():
    made, V, ball = over_a_ball()
    V = V + np.array([0.0, 0.13, 0.0], np.float32)  # 3 cm above the ball
    state = initial_state(jnp.asarray(V), jnp.asarray(ball), made.surface)

    def searched(*way: float) -> int:
        moved = jnp.asarray(V + np.array(way, np.float32))
        return int((limits(moved, jnp.asarray(ball), state) > 0).sum())

    assert searched(0.05, 0.0, 0.05) == 0
    assert searched(0.0, 0.1, 0.0) == 0
    assert searched(0.0, -0.1, 0.0) > 30


def test_searched_again_a_few_are_right_and_the_others_as_they_were():
    _, body, faces = tables()
    V, _ = sheet(0.22)
    n = SIDE * SIDE
    C, nothing = jnp.asarray(body), jnp.zeros(n, jnp.int32)
    first, origin = found(jnp.asarray(V), C, nothing, jnp.full(n, jnp.inf))
    expected = brute_signed(V.astype(np.float64), body, faces)
    np.testing.assert_allclose(first.ds, expected, atol=2e-6)
    assert first.known.all()

    moved = (V + np.random.default_rng(0).normal(scale=0.01, size=V.shape)).astype(np.float32)
    asked = np.zeros(n, bool)
    asked[np.random.default_rng(1).choice(n, 200, replace=False)] = True  # more than one chunk, less than two
    limit = np.where(asked, 0.03, -1.0).astype(np.float32)
    second = again(jnp.asarray(moved), C, first, jnp.asarray(limit))
    expected = brute_signed(moved.astype(np.float64), body, faces)
    near = asked & (np.abs(expected) < 0.03)
    assert 20 < near.sum() < asked.sum() - 20
    np.testing.assert_array_equal(second.known, near | ~asked)
    np.testing.assert_allclose(second.ds[near], expected[near], atol=2e-6)
    np.testing.assert_array_equal(second.ds[asked & ~near], np.float32(0.03))
    away = moved.T - np.asarray(second.point) - np.asarray(origin)[:, None]
    off = away - np.asarray(second.ds)[None] * np.asarray(second.direction)
    assert np.abs(off[:, near]).max() < 1e-5
    for new, old in zip(second, first, strict=True):
        np.testing.assert_array_equal(np.asarray(new)[..., ~asked], np.asarray(old)[..., ~asked])
