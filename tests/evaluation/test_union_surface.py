"""Signs and depths where a body crosses itself, against solid angles, closed forms and a sampled surface."""

import numpy as np
import pytest
import trimesh

from garment_jax.evaluation.penetration import closed_surface, neighbour_faces, signed_distance
from garment_jax.evaluation.rays import ray_boxes, winding_by_ray
from tests.evaluation.test_penetration import _two_boxes
from tests.geometry.crossing_bodies import POSES, crossing_body, numbered_points, points_around


@pytest.mark.parametrize("pose", POSES)
def test_ten_to_the_fifth_signs_around_crossing_bodies_are_those_of_the_solid_angles(pose):
    vertices, faces = crossing_body(pose)
    points, exact = numbered_points(pose)
    assert (np.rint(exact) == 2).sum() > 100  # or the pose says nothing
    np.testing.assert_array_equal(winding_by_ray(points, ray_boxes(vertices[faces])), np.rint(exact))
    some = np.concatenate([np.flatnonzero(np.rint(exact) == 2)[:40], np.arange(2000)])
    distance = signed_distance(points[some], closed_surface(vertices, faces, neighbour_faces(faces)))
    np.testing.assert_array_equal(distance < 0, exact[some] >= 0.5)


def test_depths_in_a_crossing_body_are_those_to_the_sampled_surface_of_the_union():
    vertices, faces = crossing_body("a knee in the belly")
    corners, boxes = vertices[faces], ray_boxes(vertices[faces])
    points = points_around(vertices, faces, 4000, seed=3)
    points = points[winding_by_ray(points, boxes) == 2][:12]
    near = np.linalg.norm(corners.mean(axis=1)[:, None] - points[None], axis=2).min(axis=1) < 0.12
    corners = corners[near]  # of the surface of which the nearest part is sampled
    distance = signed_distance(points, closed_surface(vertices, faces, neighbour_faces(faces)))
    many = 6  # samples a side
    weights = np.array([(i, j, many - i - j) for i in range(many + 1) for j in range(many + 1 - i)]) / many
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    samples = np.einsum("sk,fkx->fsx", weights, corners)
    beside = [winding_by_ray((samples + s * 1e-7 * flat[:, None]).reshape(-1, 3), boxes) for s in (1, -1)]
    bounding = samples.reshape(-1, 3)[(beside[0] <= 0) & (beside[1] >= 1)]
    sampled = np.linalg.norm(points[:, None] - bounding[None], axis=2).min(axis=1)
    apart = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max() / many
    assert (distance < 0).all()
    assert distance.min() > -0.09  # and so is all that may be nearest
    assert (sampled >= -distance - 1e-7).all()
    assert (sampled <= -distance + apart).all()


def test_two_boxes_that_cross_have_the_distance_of_their_union():
    vertices, faces = _two_boxes(-0.2)  # 1 m each, together from -0.5 to 1.3
    points = np.random.default_rng(0).uniform([-0.9, -0.7, -0.7], [1.7, 0.7, 0.7], (800, 3))
    distance = signed_distance(points, closed_surface(vertices, faces, neighbour_faces(faces)))
    q = np.abs(points - [0.4, 0.0, 0.0]) - [0.9, 0.5, 0.5]
    expected = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)
    np.testing.assert_allclose(distance, expected, atol=1e-12)


def test_two_balls_that_cross_are_deepest_at_the_circle_between_them():
    ball, apart, radius = trimesh.creation.icosphere(3, radius=0.3), 0.2, 0.3
    vertices = np.concatenate([ball.vertices - [apart, 0, 0], ball.vertices + [apart, 0, 0]])
    faces = np.concatenate([ball.faces, ball.faces + len(ball.vertices)])
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (100, 3)) * [0.4, 1.0, 1.0]
    distance = signed_distance(points, closed_surface(vertices, faces, neighbour_faces(faces)))
    own = [points - [side * apart, 0, 0] for side in (-1, 1)]
    heights = np.stack([np.linalg.norm(x, axis=1) - radius for x in own])
    # of each sphere the cap beyond the plane between them bounds the union, and the circle in that plane
    feet = [
        s * apart + radius * x[:, 0] / np.linalg.norm(x, axis=1) for s, x in zip((-1, 1), own, strict=True)
    ]
    on_cap = np.stack([feet[0] <= 0, feet[1] >= 0])
    circle = np.hypot(points[:, 0], np.hypot(points[:, 1], points[:, 2]) - np.sqrt(radius**2 - apart**2))
    depth = np.minimum(np.where(on_cap, np.abs(heights), np.inf).min(axis=0), circle)
    expected = np.where(heights.min(axis=0) < 0, -depth, heights.min(axis=0))
    assert (heights < 0).all(axis=0).any()
    np.testing.assert_allclose(distance, expected, atol=3e-3)  # the spheres are of triangles


def test_a_part_turned_inside_out_is_outside_and_measured_to_what_bounds():
    box = trimesh.creation.box(extents=(1.0, 1.0, 1.0))
    vertices = np.concatenate([box.vertices, 0.2 * box.vertices + [1.0, 0, 0]])
    faces = np.concatenate([box.faces, box.faces[:, ::-1] + 8])
    closed = closed_surface(vertices, faces, neighbour_faces(faces))
    np.testing.assert_allclose(signed_distance(np.array([[1.0, 0, 0], [1.2, 0, 0]]), closed), [0.5, 0.7])


@pytest.mark.parametrize("axis", range(3))
def test_rays_through_edges_and_corners_are_counted_once(axis):
    box = trimesh.creation.box(extents=(1.0, 1.0, 1.0))
    vertices, faces = np.roll(box.vertices, axis, axis=1), box.faces
    grid = np.stack(np.meshgrid(*[[-0.75, -0.25, 0.0, 0.25, 0.75]] * 3), axis=-1).reshape(-1, 3)
    inside = (np.abs(grid) < 0.5).all(axis=1)
    np.testing.assert_array_equal(winding_by_ray(grid, ray_boxes(vertices[faces])), inside)
