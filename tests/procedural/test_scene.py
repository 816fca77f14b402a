import functools

import numpy as np
import pytest
import trimesh

from garment_jax.body.kinematics import collider_points, joint_positions, pose_body, pose_points
from garment_jax.evaluation.penetration import (
    closed_surface,
    neighbour_faces,
    signed_distance,
)
from garment_jax.geometry.symmetry import mirror_permutation
from garment_jax.geometry.topology import unique_edges
from garment_jax.geometry.uv_atlas import make_atlas
from garment_jax.io.sequence import open_sequence
from garment_jax.io.sequence_writer import SequenceWriter
from garment_jax.io.validation import check_scene
from garment_jax.procedural.motions import make_dance, make_motion
from garment_jax.procedural.scene import GARMENTS, make_outfit, make_scene
from tests.procedural.bodies import avatar, mannequin

FLIP = np.array([-1, 1, 1], np.float32)


@functools.cache
def outfit(name):
    return make_outfit(name, body=mannequin())


def scene(name):
    return outfit(name)[0]


def edges_of(garment):
    """Both lengths of every edge: UV index pairs and their vertices."""
    edges = unique_edges(garment.faces_uv)
    owner = np.zeros(len(garment.uv), int)
    owner[garment.faces_uv.ravel()] = garment.faces.ravel()
    ends = garment.template[owner[edges]].astype(float)
    return edges, np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)


def signed_areas(flat, faces):
    a, b, c = (flat[faces[:, k]].astype(float) for k in range(3))
    return ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2


@pytest.mark.parametrize("name", GARMENTS)
def test_size_and_triangles(name):
    garment = scene(name).garment
    mesh = trimesh.Trimesh(garment.template, garment.faces, process=False)
    assert abs(len(garment.template) - 900) < 40
    assert len(np.unique(garment.faces)) == len(garment.template)
    assert mesh.is_winding_consistent
    assert mesh.euler_number == (1 if name == "cape" else 0)  # a sheet, a ring
    assert np.degrees(mesh.face_angles).min() > 20
    _, length = edges_of(garment)
    assert length.max() < 2.5 * length.min()


@pytest.mark.parametrize("name", GARMENTS)
def test_faces_look_outward_and_their_uvs_run_counter_clockwise(name):
    garment = scene(name).garment
    mesh = trimesh.Trimesh(garment.template, garment.faces, process=False)
    middle = garment.template[garment.faces].mean(axis=1)
    outward = middle[:, [0, 2]] / np.linalg.norm(middle[:, [0, 2]], axis=1, keepdims=True)
    facing = (mesh.face_normals[:, [0, 2]] * outward).sum(axis=1)
    assert np.median(facing) > 0.5
    assert signed_areas(garment.uv, garment.faces_uv).min() > 0


@pytest.mark.parametrize("name", GARMENTS)
def test_uvs_cover_the_square_once_and_only_the_back_seam_is_doubled(name):
    garment = scene(name).garment
    np.testing.assert_allclose(garment.uv.min(axis=0), 0.0, atol=1e-6)
    np.testing.assert_allclose(garment.uv.max(axis=0), 1.0, atol=1e-6)
    np.testing.assert_allclose(signed_areas(garment.uv, garment.faces_uv).sum(), 1.0, atol=1e-3)
    pairs = np.unique(np.stack([garment.faces.ravel(), garment.faces_uv.ravel()], 1), axis=0)
    doubled = np.flatnonzero(np.bincount(pairs[:, 0]) == 2)
    assert len(pairs) == len(garment.template) + len(doubled)
    if name == "cape":
        assert len(doubled) == 0
    else:
        assert (garment.template[doubled, 0] == 0).all()
        assert (garment.template[doubled, 2] < 0).all()
        np.testing.assert_allclose(garment.uv[np.isin(garment.uv[:, 0], [0, 1])][:, 0].sum(), len(doubled))
    make_atlas(garment, 64)


@pytest.mark.parametrize("name", GARMENTS)
def test_it_is_left_right_symmetric(name):
    garment = scene(name).garment
    p = mirror_permutation(garment)
    np.testing.assert_array_equal(p[p], np.arange(len(p)))
    np.testing.assert_allclose(garment.template[p], garment.template * FLIP, atol=1e-6)
    faces = {tuple(sorted(face)) for face in garment.faces.tolist()}
    assert {tuple(sorted(face)) for face in p[garment.faces].tolist()} == faces


@pytest.mark.parametrize("name", GARMENTS)
def test_it_is_outside_the_body_by_three_millimetres(name):
    s = scene(name)
    for vertices, faces in (
        (collider_points(s.collider, s.body.vertices), s.collider.faces),
        (s.body.vertices, s.body.faces),
    ):
        gap = signed_distance(s.garment.template, closed_surface(vertices, faces, neighbour_faces(faces)))
        assert gap.min() > 0.003


@pytest.mark.parametrize("name", GARMENTS)
def test_the_pins_are_the_upper_border_and_follow_the_trunk_smoothly(name):
    s = scene(name)
    top = np.flatnonzero(s.garment.uv[:, 1] == 1)
    faces, faces_uv = s.garment.faces.ravel(), s.garment.faces_uv.ravel()
    np.testing.assert_array_equal(np.unique(s.pins.vertices), np.unique(faces[np.isin(faces_uv, top)]))
    np.testing.assert_allclose(s.pins.weights.sum(axis=1), 1.0, atol=1e-6)
    limbs = [
        j for j, n in enumerate(s.body.joint_names) if n.endswith(("Arm", "Hand", "Leg", "Foot", "Head"))
    ]
    assert s.pins.weights[:, limbs].max() < 0.05
    assert np.abs(np.diff(s.pins.weights, axis=0)).max() < 0.25


@pytest.mark.parametrize("name", GARMENTS)
def test_the_pins_stay_outside_a_dancing_body(name):
    s, m = scene(name), make_dance(mannequin(), seconds=24, seed=1)
    some = np.arange(30, 720, 60)
    positions = joint_positions(m.rotations[some], m.root[some], s.body)
    pins = s.garment.template[s.pins.vertices]
    carried = pose_points(pins, s.pins.weights, m.rotations[some], positions, s.body.joints)
    skin = collider_points(s.collider, pose_body(s.body, m, some))
    sides = neighbour_faces(s.collider.faces)
    for V, body in zip(carried, skin, strict=True):
        assert signed_distance(V, closed_surface(body, s.collider.faces, sides)).min() > 0.0


@pytest.mark.parametrize("name", ["skirt", "circle_skirt"])
def test_the_flat_pattern_has_the_templates_lengths(name):
    s, pattern = outfit(name)
    edges, length = edges_of(s.garment)
    flat = np.linalg.norm(pattern[edges[:, 0]] - pattern[edges[:, 1]], axis=1)
    strain = np.abs(length / flat - 1)
    mean, largest = (0.001, 0.01) if name == "skirt" else (0.025, 0.2)
    assert strain.mean() < mean
    assert strain.max() < largest
    assert signed_areas(pattern, s.garment.faces_uv).min() > 0


def test_the_circle_skirts_pattern_is_a_whole_ring():
    s, pattern = outfit("circle_skirt")
    radius = np.linalg.norm(pattern, axis=1)
    area = signed_areas(pattern, s.garment.faces_uv).sum()
    np.testing.assert_allclose(area, np.pi * (radius.max() ** 2 - radius.min() ** 2), rtol=0.01)
    np.testing.assert_allclose(radius.max() - radius.min(), 0.5, atol=1e-3)


@pytest.mark.parametrize("name", GARMENTS)
def test_a_clip_of_it_is_written_and_read(name, tmp_path):
    s = scene(name)
    check_scene(s, name)
    motion = make_motion("walk", s.body, seconds=0.1)
    with SequenceWriter(tmp_path / "clip.h5", s, motion) as writer:
        writer.append(s.garment.template[None] + motion.root[:, None] - s.body.joints[:1])
    with open_sequence(tmp_path / "clip.h5") as clip:
        np.testing.assert_array_equal(clip.scene.garment.faces, s.garment.faces)


@pytest.mark.parametrize(("name", "vertices"), [("skirt", 300), ("dress", 2500), ("cape", 400)])
def test_the_number_of_vertices_is_about_what_was_asked(name, vertices):
    made = make_outfit(name, vertices=vertices, body=mannequin())[0]
    assert abs(len(made.garment.template) / vertices - 1) < 0.1


def test_a_scene_is_an_outfit_without_its_pattern_and_comes_out_the_same_each_time():
    again, first = make_scene("cape"), scene("cape")
    for part in ("garment", "body", "collider", "pins"):
        for one, other in zip(getattr(again, part), getattr(first, part), strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", GARMENTS)
def test_the_shared_avatar_can_wear_it(name, shared_data):
    body, collider = avatar(shared_data)
    worn = make_outfit(name, body=body, collider=collider)[0]
    mirror_permutation(worn.garment)
    assert np.abs(worn.pins.weights.sum(axis=1) - 1).max() < 1e-6


def test_refusals():
    with pytest.raises(
        ValueError, match="garment 'hat' is unknown; choose one of skirt, circle_skirt, dress, cape"
    ):
        make_scene("hat")
    with pytest.raises(ValueError, match="--vertices 10 must lie between 100 and 100000"):
        make_outfit(vertices=10, body=mannequin())
