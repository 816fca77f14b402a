"""Winding numbers by rays in float32, against the sums of all solid angles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.geometry.ray_winding import winding_by_ray
from garment_jax.geometry.surface_search import pose_surface
from garment_jax.geometry.surface_tables import make_surface_tables
from garment_jax.geometry.winding_number import winding_number
from tests.geometry.crossing_bodies import POSES, crossing_body, points_around, rest_body

TABLES = make_surface_tables(*rest_body())


@jax.jit
def by_ray(points, vertices, ahead, asked):
    surface = pose_surface(vertices, TABLES)
    return winding_by_ray(points.T - surface.origin[:, None], ahead, asked, surface, TABLES)


@pytest.mark.parametrize("pose", POSES)
def test_the_numbers_are_those_of_the_solid_angles_whichever_way_the_rays_go(pose):
    vertices, faces = crossing_body(pose)
    points = points_around(vertices, faces, 1000, seed=1).astype(np.float32)
    vertices = vertices.astype(np.float32)
    exact = np.rint(winding_number(points, vertices, faces))
    assert set(np.unique(exact)) >= {0.0, 1.0, 2.0}
    everyone = np.ones(len(points), bool)
    for ahead in (everyone, ~everyone):
        np.testing.assert_array_equal(by_ray(points, vertices, ahead, everyone), exact)
    some = np.arange(len(points)) % 3 == 0
    np.testing.assert_array_equal(by_ray(points, vertices, everyone, some), np.where(some, exact, 0))


def test_rays_through_edges_and_corners_are_counted_once():
    vertices, _ = crossing_body("pressed thighs")
    corners = vertices.astype(np.float32)[:1000]
    below = corners - np.array([0, 0, 9.0], np.float32)  # outside, the ray goes through a corner exactly
    ahead = jnp.ones(len(below), bool)
    np.testing.assert_array_equal(by_ray(below, vertices.astype(np.float32), ahead, ahead), 0)


def test_a_part_turned_inside_out_has_a_negative_number():
    vertices, _ = rest_body()
    mirrored = vertices.astype(np.float32) * np.array([-1, 1, 1], np.float32)
    middle = np.resize(mirrored.mean(axis=0), (1000, 3))
    asked = np.ones(1000, bool)
    assert set(np.asarray(by_ray(middle, mirrored, asked, asked))) == {-1}
