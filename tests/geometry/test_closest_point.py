from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from garment_jax.geometry.closest_point import (
    closest_point_exact,
    closest_point_from,
)
from garment_jax.geometry.surface_tables import make_surface_tables, point_groups
from tests.geometry.surfaces import box, box_distance, brute_distance, brute_signed, bumpy

exact = jax.jit(closest_point_exact)
following = jax.jit(closest_point_from)


def f32(x) -> jax.Array:
    return jnp.asarray(x, jnp.float32)


@pytest.fixture(scope="module")
def cloud() -> np.ndarray:
    return np.random.default_rng(1).uniform(-0.45, 0.45, size=(600, 3))


def test_box_has_its_closed_form_inside_outside_at_edges_and_corners(cloud):
    vertices, faces = box()
    ds = exact(f32(cloud), f32(vertices), make_surface_tables(vertices, faces)).ds
    np.testing.assert_allclose(ds, box_distance(cloud), atol=2e-7)


def test_bumpy_surface_equals_brute_force_with_the_winding_numbers_sign(cloud):
    vertices, faces = bumpy()
    answer = exact(f32(cloud), f32(vertices), make_surface_tables(vertices, faces))
    expected = brute_signed(cloud, vertices, faces)
    assert (expected < 0).sum() > 30
    np.testing.assert_allclose(answer.ds, expected, atol=1e-6)


def test_closest_points_equal_trimesh(cloud):
    vertices, faces = bumpy()
    answer = exact(f32(cloud), f32(vertices), make_surface_tables(vertices, faces))
    points = cloud[:60]
    every = np.repeat(points, len(faces), axis=0)
    on = trimesh.triangles.closest_point(np.tile(vertices[faces], (len(points), 1, 1)), every)
    on = on.reshape(len(points), -1, 3)
    distance = np.linalg.norm(on - points[:, None], axis=2)
    expected = on[np.arange(len(points)), distance.argmin(axis=1)]
    unique = np.sort(distance, axis=1)[:, 7] - distance.min(axis=1) > 1e-5  # not halfway between two
    np.testing.assert_allclose(np.abs(answer.ds[:60]), distance.min(axis=1), atol=1e-6)
    # A millionth of the distance, which float32's squares do not tell apart, is a thousandth of it sideways.
    off = np.linalg.norm(answer.point[:60] - expected, axis=1)
    assert (off < 1e-5 + 1.5e-3 * distance.min(axis=1))[unique].all()


def test_float64_agrees_to_its_digits(cloud):
    vertices, faces = bumpy()
    with jax.enable_x64(True):
        tables = make_surface_tables(vertices, faces)
        ds = exact(jnp.asarray(cloud), jnp.asarray(vertices), tables).ds
    # The search's key keeps 21 bits, which can only confuse triangles that are equally near.
    np.testing.assert_allclose(ds, brute_signed(cloud, vertices, faces), atol=1e-6)


def test_far_from_the_origin_only_the_inputs_digits_are_lost(cloud):
    vertices, faces = box()
    tables = make_surface_tables(vertices, faces)
    shift = np.array([[512.0, -256.0, 1024.0]])
    near = np.round(cloud * 2**12) / 2**12  # representable after the shift
    moved = np.round(vertices * 2**12) / 2**12
    ds = exact(f32(near), f32(moved), tables).ds
    far = exact(f32(near + shift), f32(moved + shift), tables).ds
    np.testing.assert_allclose(far, ds, atol=1e-4)


@pytest.mark.parametrize("movement", [0.001, 0.03, 0.3])
def test_the_bounded_search_equals_the_exact_one(cloud, movement):
    vertices, faces = bumpy()
    tables, groups = make_surface_tables(vertices, faces), point_groups(cloud)
    rng = np.random.default_rng(0)
    previous = exact(f32(cloud), f32(vertices), tables).triangle
    points = f32(cloud + movement * rng.normal(size=(1, 3)) + 0.3 * movement * rng.normal(size=cloud.shape))
    expected = exact(points, f32(vertices), tables)
    answer = following(previous, points, f32(vertices), tables, groups)
    np.testing.assert_allclose(answer.ds, expected.ds, atol=1e-7)


def test_deep_inside_after_a_jump_is_still_inside(cloud):
    vertices, faces = bumpy()
    tables = make_surface_tables(vertices, faces)
    away = cloud + [[2.0, 0.0, 0.0]]
    previous = exact(f32(away), f32(vertices), tables).triangle
    inside = f32(0.1 * cloud)
    answer = following(previous, inside, f32(vertices), tables, point_groups(cloud))
    assert (answer.ds < -0.1).all()


def test_gradient_of_the_signed_distance_is_its_direction(cloud):
    vertices, faces = bumpy()
    tables = make_surface_tables(vertices, faces)
    answer = exact(f32(cloud), f32(vertices), tables)
    gradient = jax.jit(jax.grad(lambda p: closest_point_exact(p, f32(vertices), tables).ds.sum()))
    np.testing.assert_allclose(gradient(f32(cloud)), answer.direction, atol=2e-3)


def test_points_on_corners_edges_and_faces_have_finite_gradients_and_outward_normals():
    vertices, faces = box()
    tables = make_surface_tables(vertices, faces)
    corners = vertices[faces]
    on = np.concatenate([vertices, corners[:, :2].mean(axis=1), corners.mean(axis=1)])
    answer = exact(f32(on), f32(vertices), tables)
    np.testing.assert_allclose(answer.ds, 0.0, atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(answer.direction, axis=1), 1.0, atol=1e-5)
    assert ((answer.normal * on).sum(axis=1) > 0).all()
    total = partial(lambda p, v: closest_point_exact(p, v, tables).ds.sum())
    for gradient in jax.jit(jax.grad(total, argnums=(0, 1)))(f32(on), f32(vertices)):
        assert np.isfinite(gradient).all()


def test_triangles_without_area_do_no_harm():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [1, 0, 0]], float)
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 4, 1], [3, 0, 4]])
    tables = make_surface_tables(vertices, faces)
    points = np.random.default_rng(0).normal(size=(200, 3))
    points[:5] = vertices
    total = jax.jit(
        jax.value_and_grad(lambda p: jnp.abs(closest_point_exact(p, f32(vertices), tables).ds).sum())
    )
    value, gradient = total(f32(points))
    assert np.isfinite(gradient).all()
    assert value == pytest.approx(brute_distance(points, vertices, faces).sum(), rel=1e-5)
