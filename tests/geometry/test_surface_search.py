import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.geometry.surface_search import distance_to, distance_to_any, pose_surface, search
from garment_jax.geometry.surface_tables import make_surface_tables, point_groups
from tests.geometry.surfaces import brute_distance, bumpy

find = jax.jit(search)


def setting():
    vertices, faces = bumpy()
    tables = make_surface_tables(vertices, faces)
    cloud = np.random.default_rng(1).uniform(-0.45, 0.45, size=(400, 3)).astype(np.float32)
    surface = pose_surface(jnp.asarray(vertices, jnp.float32), tables)
    return cloud, surface, tables, brute_distance(cloud.astype(np.float64), vertices, faces)


def test_each_point_finds_what_lies_within_its_own_limit():
    cloud, surface, _, expected = setting()
    groups = point_groups(cloud)
    limit = np.random.default_rng(2).uniform(-0.05, 0.2, size=len(cloud)).astype(np.float32)
    local = jnp.asarray(cloud) - surface.origin[None]
    found = find(local[groups], jnp.asarray(limit)[groups], surface)
    within = (expected < limit)[groups]
    np.testing.assert_array_equal(found.triangle >= 0, within)
    assert 50 < within.sum() < within.size - 50
    np.testing.assert_allclose(np.sqrt(found.squared)[within], expected[groups][within], rtol=2e-6, atol=1e-7)


def test_no_limit_at_all_is_brute_force():
    cloud, surface, _, expected = setting()
    local = jnp.asarray(cloud)[:, None] - surface.origin[None, None]
    found = find(local, jnp.full((len(cloud), 1), jnp.inf), surface)
    np.testing.assert_allclose(np.sqrt(found.squared[:, 0]), expected, rtol=2e-6, atol=1e-7)


def test_nobody_asked_and_nan_find_nothing():
    cloud, surface, _, _ = setting()
    local = jnp.asarray(cloud)[:, None] - surface.origin[None, None]
    assert (find(local, jnp.full((len(cloud), 1), -1.0), surface).triangle == -1).all()
    assert (find(local * jnp.nan, jnp.full((len(cloud), 1), 0.1), surface).triangle == -1).all()


def test_bounds_are_above_the_distance():
    cloud, surface, tables, expected = setting()
    local = jnp.asarray(cloud) - surface.origin[None]
    any_bound = distance_to_any(local, surface)
    named = distance_to(jnp.arange(len(cloud)) % len(tables.faces), local, surface)
    assert (np.asarray(any_bound) > expected).all()
    assert (np.asarray(named) > expected).all()


def test_two_bytes_search_too():
    cloud, surface, _, expected = setting()
    coarse = jax.tree.map(lambda x: x.astype(jnp.bfloat16), surface)
    local = (jnp.asarray(cloud)[:, None] - surface.origin[None, None]).astype(jnp.bfloat16)
    found = find(local, jnp.full((len(cloud), 1), jnp.inf, jnp.bfloat16), coarse)
    assert (found.triangle >= 0).all()
    assert np.abs(np.sqrt(found.squared[:, 0].astype(jnp.float32)) - expected).max() < 0.01
