import numpy as np
import pytest
import trimesh

from garment_jax.evaluation.surface import closest_point, enclosing_radius, farthest, make_surface
from garment_jax.evaluation.triangles import FACE, closest_on_triangle


def _brute_force(points, corners):
    """Distance to every triangle by trimesh's routine, one query at a time."""
    best = []
    for p in points:
        at = trimesh.triangles.closest_point(corners, np.tile(p, (len(corners), 1)))
        best.append(np.linalg.norm(at - p, axis=1).min())
    return np.array(best)


def test_closest_point_on_a_triangle_equals_trimesh():
    rng = np.random.default_rng(1)
    points, corners = rng.normal(size=(500, 3)), rng.normal(size=(500, 3, 3))
    expected = trimesh.triangles.closest_point(corners, points)
    np.testing.assert_allclose(closest_on_triangle(points, corners).point, expected, atol=1e-9)


@pytest.mark.parametrize(
    ("point", "feature", "distance"),
    [
        ((-1.0, -1.0, 0.0), 0, np.sqrt(2)),
        ((2.0, -1.0, 0.0), 1, np.sqrt(2)),
        ((0.5, -1.0, 0.0), 3, 1.0),
        ((1.0, 1.0, 0.0), 4, np.sqrt(0.5)),
        ((-1.0, 0.5, 0.0), 5, 1.0),
        ((0.2, 0.2, 3.0), FACE, 3.0),
    ],
)
def test_features_of_the_unit_triangle(point, feature, distance):
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    hit = closest_on_triangle(np.array([point]), corners)
    assert hit.feature[0] == feature
    assert hit.distance[0] == pytest.approx(distance)


def test_a_triangle_without_area_is_a_segment_or_a_point():
    line = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], [[1.0, 1, 1]] * 3])
    hit = closest_on_triangle(np.array([[1.5, 2.0, 0.0], [1.0, 1.0, 3.0]]), line)
    np.testing.assert_allclose(hit.distance, [2.0, 2.0])
    np.testing.assert_allclose(enclosing_radius(line), [1.0, 0.0])


def test_enclosing_radius_of_acute_and_obtuse_triangles():
    equilateral = [[0.0, 0, 0], [1, 0, 0], [0.5, np.sqrt(0.75), 0]]
    obtuse = [[0.0, 0, 0], [4, 0, 0], [2, 0.1, 0]]
    np.testing.assert_allclose(enclosing_radius(np.array([equilateral, obtuse])), [1 / np.sqrt(3), 2.0])


@pytest.mark.parametrize("spread", [0.1, 3.0, 100.0])
def test_exact_near_and_far_on_a_mesh_with_triangles_of_every_size(spread):
    rng = np.random.default_rng(2)
    mesh = trimesh.creation.icosphere(2)
    vertices = mesh.vertices * [1.0, 0.3, 2.0]
    giant = np.array([[3.0, 0, 0], [3, 5, 0], [3, 0, 7]])  # one far larger than the rest
    vertices = np.concatenate([vertices, giant, rng.normal(size=(60, 3))])
    n = len(mesh.vertices)
    faces = np.concatenate([mesh.faces, [[n, n + 1, n + 2]], rng.integers(n + 3, len(vertices), (40, 3))])
    points = spread * rng.normal(size=(150, 3))
    hit = closest_point(points, make_surface(vertices, faces))
    np.testing.assert_allclose(hit.distance, _brute_force(points, vertices[faces]), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(hit.point - points, axis=1), hit.distance, atol=1e-12)


def test_a_class_of_triangles_that_is_near_none_of_the_queries_is_passed_over():
    """Its corner is within reach of the class's largest triangle, its own triangle is too small to matter."""
    right = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])  # radius sqrt(1/2) of the longest edge
    near, middle, large = 0.7 * right, 1.6 * right + [0.0, 0, 1.5], 2.6 * right + [30.0, 0, 0]
    vertices = np.concatenate([near, near, near, middle, large])
    surface = make_surface(vertices, np.arange(15).reshape(5, 3))
    assert [len(group.start) - 1 for group in surface.classes] == [9, 6]
    hit = closest_point(np.array([[0.2, 0.2, 0.01]]), surface)
    assert hit.distance[0] == pytest.approx(0.01)


@pytest.mark.parametrize("spread", [0.1, 1.0, 30.0])
def test_the_farthest_point_is_the_largest_of_all_distances(spread):
    mesh = trimesh.creation.icosphere(2)
    points = spread * np.random.default_rng(3).normal(size=(700, 3))
    largest = _brute_force(points, mesh.triangles).max()
    surface = make_surface(mesh.vertices, mesh.faces)
    assert farthest(points, surface) == pytest.approx(largest, rel=1e-9)
    assert farthest(points, surface, at_least=2 * largest) == 2 * largest
