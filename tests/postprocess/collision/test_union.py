"""Contacts where a body crosses itself: sides by solid angles, depths against the exact measure."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.evaluation.penetration import closed_surface, neighbour_faces, signed_distance
from garment_jax.evaluation.rays import ray_boxes, winding_by_ray
from garment_jax.geometry.closest_point import closest_point_exact
from garment_jax.geometry.laplacian import uniform_table
from garment_jax.geometry.surface_search import pose_surface
from garment_jax.geometry.surface_tables import make_surface_tables, point_groups
from garment_jax.postprocess.collision import CollisionTables, make_collision_tables
from garment_jax.postprocess.collision.contacts import Contacts
from garment_jax.postprocess.collision.union import sided
from tests.geometry.crossing_bodies import POSES, crossing_body, numbered_points, rest_body
from tests.postprocess.collision.cloth import sheet


@lru_cache
def made() -> CollisionTables:
    V, faces = sheet()
    return make_collision_tables(V, uniform_table(faces, len(V)), make_surface_tables(*rest_body()))


@jax.jit
def contacts(points, body, groups, group):
    tables = made()._replace(groups=groups, group=group)
    surface = pose_surface(body, tables.surface)
    nearest = closest_point_exact(points, body, tables.surface)
    local, here = (x.T - surface.origin[:, None] for x in (points, nearest.point))
    known = jnp.ones(len(points), bool)
    at = Contacts(nearest.triangle, nearest.ds, known, here, nearest.direction.T)
    return sided(at, known, local, surface, tables)[0], at, surface.origin


@pytest.mark.parametrize("pose", POSES)
def test_ten_to_the_fifth_sides_are_those_of_the_solid_angles(pose):
    vertices, faces = crossing_body(pose)
    points, exact = numbered_points(pose)
    points, exact, vertices = points.astype(np.float32), np.rint(exact), vertices.astype(np.float32)
    groups = point_groups(points)
    group = np.empty(len(points), np.int32)
    group[groups] = np.arange(len(groups))[:, None]
    at, before, origin = contacts(points, vertices, groups, group)
    off = np.abs(np.asarray(before.ds)) > 1e-6
    inside, was_inside = np.asarray(at.ds) < 0, np.asarray(before.ds) < 0
    np.testing.assert_array_equal(inside[off], exact[off] >= 1)
    assert (inside != was_inside).sum() > 30  # or the nearest sheet would do
    same = exact == was_inside
    np.testing.assert_array_equal(np.asarray(at.ds)[same & off], np.asarray(before.ds)[same & off])
    _depths_are_right(at, points, origin, vertices, faces, exact == 2)


def _depths_are_right(at, points, origin, vertices, faces, covered):
    """Depths are never too small, and too large by less than a triangle is long."""
    some = np.flatnonzero(covered)[:60]
    expected = signed_distance(points[some], closed_surface(vertices, faces, neighbour_faces(faces)))
    edges = vertices[faces] - np.roll(vertices[faces], 1, axis=1)
    ds = np.asarray(at.ds, np.float64)[some]
    assert (ds <= expected + 1e-5).all()
    assert (ds >= expected - np.linalg.norm(edges, axis=-1).max()).all()
    beside = (np.asarray(at.point.T) + np.asarray(origin))[some] + 1e-4 * np.asarray(at.direction.T)[some]
    on = winding_by_ray(beside, ray_boxes(vertices.astype(np.float64)[faces]))
    assert (on <= 0).mean() > 0.9  # at a crease the way out of one part may lead into the other
