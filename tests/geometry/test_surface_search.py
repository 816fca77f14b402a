import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.geometry.surface_search import (
    distance_to,
    distance_to_corner,
    nearest_leaf,
    pose_surface,
    search,
)
from garment_jax.geometry.surface_tables import make_surface_tables, point_groups
from tests.geometry.surfaces import brute_distance, bumpy

find = jax.jit(search)


def setting():
    vertices, faces = bumpy()
    tables = make_surface_tables(vertices, faces)
    cloud = np.random.default_rng(1).uniform(-0.45, 0.45, size=(400, 3)).astype(np.float32)
    surface = pose_surface(jnp.asarray(vertices, jnp.float32), tables)
    return cloud, surface, tables, brute_distance(cloud.astype(np.float64), vertices, faces)


def alone(cloud: np.ndarray, surface) -> jax.Array:
    """Return the points in groups of one."""
    return (jnp.asarray(cloud) - surface.origin[None]).T[:, None]


def test_each_point_finds_what_lies_within_its_own_limit():
    cloud, surface, _, expected = setting()
    groups = point_groups(cloud)
    limit = np.random.default_rng(2).uniform(-0.05, 0.2, size=len(cloud)).astype(np.float32)
    local = jnp.asarray(cloud) - surface.origin[None]
    groups = groups.T
    found = find(local.T[:, groups], jnp.asarray(limit)[groups], surface)
    within = (expected < limit)[groups]
    np.testing.assert_array_equal(found.triangle >= 0, within)
    assert 50 < within.sum() < within.size - 50
    np.testing.assert_allclose(np.sqrt(found.squared)[within], expected[groups][within], rtol=2e-6, atol=1e-7)


def test_no_limit_at_all_is_brute_force():
    cloud, surface, _, expected = setting()
    local = alone(cloud, surface)
    found = find(local, jnp.full((1, len(cloud)), jnp.inf), surface)
    np.testing.assert_allclose(np.sqrt(found.squared[0]), expected, rtol=2e-6, atol=1e-7)


def test_nobody_asked_and_nan_find_nothing():
    cloud, surface, _, _ = setting()
    local = alone(cloud, surface)
    assert (find(local, jnp.full((1, len(cloud)), -1.0), surface).triangle == -1).all()
    assert (find(local * jnp.nan, jnp.full((1, len(cloud)), 0.1), surface).triangle == -1).all()


def test_bounds_are_above_the_distance():
    cloud, surface, tables, expected = setting()
    local = jnp.asarray(cloud) - surface.origin[None]
    triangle = jnp.arange(len(cloud)) % len(tables.faces)
    named = distance_to(triangle, local.T, surface, tables)
    corner = distance_to_corner(triangle, local, surface, tables)
    any_bound = distance_to_corner(nearest_leaf(local, surface, tables), local, surface, tables)
    assert (np.asarray(any_bound) > expected).all()
    assert (corner >= named - 1e-6).all()
    assert np.median(any_bound) < np.median(corner)
    assert (np.asarray(named) > expected).all()


def test_two_bytes_search_too():
    cloud, surface, _, expected = setting()
    coarse = jax.tree.map(lambda x: x.astype(jnp.bfloat16), surface)
    local = alone(cloud, surface).astype(jnp.bfloat16)
    found = find(local, jnp.full((1, len(cloud)), jnp.inf, jnp.bfloat16), coarse)
    assert (found.triangle >= 0).all()
    assert np.abs(np.sqrt(found.squared[0].astype(jnp.float32)) - expected).max() < 0.01


def test_leaves_and_branches_lie_between_their_planes_and_in_their_boxes():
    _, surface, tables, _ = setting()
    middle, half, leaf_slab = np.split(np.asarray(surface.bounds).swapaxes(0, 1).reshape(11, -1), [3, 6])
    for slab in (np.asarray(surface.branch_slab), leaf_slab):
        vertices = np.asarray(surface.flat).reshape(3, -1).T
        corners = vertices[tables.faces].reshape(slab.shape[1], -1, 3)
        height = np.einsum("lkx,xl->kl", corners, slab[:3])
        assert (np.abs(height - slab[3]) <= slab[4]).all()
        np.testing.assert_allclose(np.linalg.norm(slab[:3], axis=0), 1.0, atol=1e-5)
    assert np.median(slab[4]) < 0.5 * np.median(half.max(axis=0))  # what it is for: thin
    away = np.abs(corners - middle.T[:, None]) - half.T[:, None]
    assert away.max() < 1e-6
