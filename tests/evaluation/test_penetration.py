import numpy as np
import pytest
import trimesh

from garment_jax.body.kinematics import collider_points, pose_body
from garment_jax.evaluation.penetration import (
    closed_surface,
    neighbour_faces,
    penetration,
    pinched,
    signed_distance,
)
from tests.reference.scene import make_motion, make_scene


def _winding(points, corners):
    """Generalised winding number by solid angles (Van Oosterom and Strackee), 1 inside, 0 outside."""
    total = np.zeros(len(points))
    for a, b, c in corners:
        u, v, w = a - points, b - points, c - points
        lu, lv, lw = (np.linalg.norm(x, axis=1) for x in (u, v, w))
        top = (u * np.cross(v, w)).sum(1)
        below = lu * lv * lw + (u * v).sum(1) * lw + (v * w).sum(1) * lu + (w * u).sum(1) * lv
        total += 2 * np.arctan2(top, below)
    return total / (4 * np.pi)


def _box_distance(points, half):
    """Closed form of the signed distance to a box."""
    q = np.abs(points) - half
    return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)


def test_box_in_closed_form_at_faces_edges_and_corners():
    box = trimesh.creation.box(extents=(2.0, 1.0, 0.5))
    points = np.random.default_rng(4).uniform(-1.6, 1.6, (600, 3))
    distance = signed_distance(points, closed_surface(box.vertices, box.faces, neighbour_faces(box.faces)))
    np.testing.assert_allclose(distance, _box_distance(points, [1.0, 0.5, 0.25]), atol=1e-12)


def test_sign_equals_the_winding_number_and_size_trimesh_on_a_concave_solid():
    mesh = trimesh.creation.icosphere(2)
    r = 1 + 0.45 * np.sin(4 * mesh.vertices[:, :1]) * np.cos(5 * mesh.vertices[:, 1:2])
    vertices, faces = mesh.vertices * r, mesh.faces
    points = np.random.default_rng(5).uniform(-1.5, 1.5, (200, 3))
    distance = signed_distance(points, closed_surface(vertices, faces, neighbour_faces(faces)))
    inside = _winding(points, vertices[faces]) > 0.5
    np.testing.assert_array_equal(distance < 0, inside)
    corners = vertices[faces]
    for p, d in zip(points[:40], distance[:40], strict=True):
        at = trimesh.triangles.closest_point(corners, np.tile(p, (len(corners), 1)))
        assert abs(d) == pytest.approx(np.linalg.norm(at - p, axis=1).min())


def test_sharp_edges_and_corners_need_all_their_faces():
    # A blade: at an edge sharper than a right angle one face alone calls outside points inside.
    vertices = np.array([[0, 0, -1], [0, 0, 1], [1, 0.05, 0], [1, -0.05, 0]], float)
    faces = trimesh.Trimesh(vertices, [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]).faces
    corners = vertices[faces]
    middle = vertices.mean(axis=0)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = ((corners.mean(axis=1) - middle) * flat).sum(axis=1) > 0
    faces = np.where(outward[:, None], faces, faces[:, ::-1])
    points = np.random.default_rng(10).uniform(-1.5, 1.5, (500, 3))
    distance = signed_distance(points, closed_surface(vertices, faces, neighbour_faces(faces)))
    np.testing.assert_array_equal(distance < 0, _winding(points, vertices[faces]) > 0.5)


def test_posed_collider_of_the_reference_scene_has_an_inside():
    scene = make_scene()
    motion = make_motion(scene, 3)
    body = pose_body(scene.body, motion, np.array([2]))
    collider = collider_points(scene.collider, body)[0].astype(np.float64)
    faces = scene.collider.faces
    corners = collider[faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    outside, inside = corners.mean(1) + 1e-4 * flat, corners.mean(1) - 1e-4 * flat
    neighbours = neighbour_faces(faces)
    assert (signed_distance(outside, closed_surface(collider, faces, neighbours)) > 0).all()
    assert (signed_distance(inside, closed_surface(collider, faces, neighbours)) < 0).all()


def test_neighbours_are_the_faces_across_each_edge():
    faces = trimesh.creation.box().faces
    across = neighbour_faces(faces)
    for f in range(len(faces)):
        for i in range(3):
            edge = {int(faces[f, i]), int(faces[f, (i + 1) % 3])}
            assert across[f, i] != f
            assert edge <= set(faces[across[f, i]].tolist())


@pytest.mark.parametrize("damage", ["open", "flipped"])
def test_a_surface_without_an_inside_is_refused(damage):
    faces = trimesh.creation.box().faces.copy()
    faces = faces[1:] if damage == "open" else np.concatenate([faces[:1, ::-1], faces[1:]])
    with pytest.raises(ValueError, match="edges without exactly two faces"):
        neighbour_faces(faces)


def test_penetration_counts_below_a_tenth_of_a_millimetre_and_finds_the_deepest():
    figures = penetration(np.array([0.01, -0.00005, -0.00011, -0.02]))
    assert figures.inside_percent == pytest.approx(50.0)
    assert figures.deepest_mm == pytest.approx(20.0)
    assert penetration(np.array([0.01, 0.02])) == (0.0, 0.0)


def _two_boxes(gap):
    """Boxes of 1 m side by side along x, `gap` metres apart; they cross where it is negative."""
    left = trimesh.creation.box(extents=(1.0, 1.0, 1.0))
    right = left.vertices + [1.0 + gap, 0.0, 0.0]
    vertices = np.concatenate([left.vertices, right])
    return vertices, np.concatenate([left.faces, left.faces + len(left.vertices)])


def test_pinched_is_what_lies_where_the_surface_crosses_itself():
    vertices, faces = _two_boxes(-0.2)
    neighbours = neighbour_faces(faces)
    points = np.array(
        [
            [0.4, 0.0, 0.0],  # in both boxes
            [0.45, 0.45, 0.0],  # in both, near the top
            [0.0, 0.45, 0.0],  # in the left one alone
            [0.9, 0.0, 0.4],  # in the right one alone
        ]
    )
    assert (signed_distance(points, closed_surface(vertices, faces, neighbours)) < 0).all()
    stuck = pinched(points, closed_surface(vertices, faces, neighbours))
    np.testing.assert_array_equal(stuck, [True, True, False, False])


@pytest.mark.parametrize(("gap", "stuck"), [(0.0005, True), (0.002, False)])
def test_parts_that_touch_pinch_what_lies_at_their_contact_and_parts_apart_do_not(gap, stuck):
    vertices, faces = _two_boxes(gap)
    points = np.array([[0.49, 0.0, 0.0], [0.51 + gap, 0.2, 0.0], [-0.49, 0.0, 0.0]])
    closed = closed_surface(vertices, faces, neighbour_faces(faces))
    np.testing.assert_array_equal(pinched(points, closed), [stuck, stuck, False])
