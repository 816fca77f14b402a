import numpy as np
import pytest
import trimesh

from garment_jax.body.kinematics import collider_points, pose_body
from garment_jax.procedural.mannequin import make_mannequin, mannequin_collider
from garment_jax.procedural.pose import joint, world_rotations
from garment_jax.procedural.skeleton import JOINT_NAMES, JOINTS, PARENTS, PARTNERS
from garment_jax.structs import Motion
from tests.geometry.surfaces import winding_number
from tests.procedural.bodies import mannequin

FLIP = np.array([-1, 1, 1], np.float32)


def mesh_of(vertices, faces):
    return trimesh.Trimesh(vertices, faces, process=False)


def posed(degrees: dict[str, tuple[float, float, float]]):
    """The mannequin with these joint angles, its root where it stands."""
    angles = np.zeros((1, 22, 3))
    for name, turn in degrees.items():
        angles[:, joint(name)] = turn
    rotations = world_rotations(angles, np.zeros(1), mannequin())
    return pose_body(mannequin(), Motion(rotations, JOINTS[:1].astype(float), 30.0), slice(None))[0]


def test_the_skin_is_one_closed_outward_surface_of_decent_triangles():
    body = mannequin()
    mesh = mesh_of(body.vertices, body.faces)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    assert mesh.body_count == 1
    assert 0.045 < mesh.volume < 0.065  # 45 to 65 litres
    assert np.degrees(mesh.face_angles).min() > 22
    assert 3000 <= len(body.vertices) <= 6000


def test_it_stands_on_the_floor_at_the_height_of_a_woman():
    low, high = mannequin().vertices.min(axis=0), mannequin().vertices.max(axis=0)
    assert low[1] == 0.0
    assert 1.6 < high[1] < 1.7
    assert high[2] > 0.15 > 0.14 > -low[2]  # the toes point to +Z


def test_left_and_right_are_exact_mirror_images():
    body = mannequin()
    order, mirrored = (np.lexsort(v.T) for v in (body.vertices, body.vertices * FLIP))
    np.testing.assert_array_equal(body.vertices[order], (body.vertices * FLIP)[mirrored])
    np.testing.assert_array_equal(body.skin_weights[order], body.skin_weights[mirrored][:, PARTNERS])
    twin = np.empty(len(order), int)
    twin[mirrored] = order
    turned = np.sort(np.sort(twin[body.faces], axis=1).view("i8,i8,i8"), axis=0)
    np.testing.assert_array_equal(
        turned, np.sort(np.sort(body.faces.astype(int), axis=1).view("i8,i8,i8"), axis=0)
    )


def test_the_skeleton_is_the_shared_avatars(shared_data):
    avatar = np.load(shared_data / "avatar" / "avatar.npz")
    assert tuple(avatar["joint_names"]) == JOINT_NAMES
    np.testing.assert_array_equal(avatar["parents"], PARENTS)
    np.testing.assert_allclose(JOINTS, avatar["joints"], atol=0.06)


def test_every_joint_lies_inside_the_skin():
    body = mannequin()
    np.testing.assert_allclose(winding_number(body.joints, body.vertices, body.faces), 1.0, atol=1e-3)


def test_skin_weights_sum_to_one_and_no_leg_moves_the_other():
    body = mannequin()
    np.testing.assert_allclose(body.skin_weights.sum(axis=1), 1.0, atol=1e-5)
    assert body.skin_weights.min() >= 0
    right = (body.vertices[:, 0] < -0.03) & (body.vertices[:, 1] < 0.7)
    left_leg = [j for j, name in enumerate(JOINT_NAMES) if name.startswith("Left")]
    assert body.skin_weights[np.ix_(right, left_leg)].max() == 0.0
    arms = [j for j, name in enumerate(JOINT_NAMES) if name.endswith(("Arm", "Hand"))]
    trunk = (np.abs(body.vertices[:, 0]) < 0.2) & (body.vertices[:, 1] < 1.0)
    assert body.skin_weights[np.ix_(trunk, arms)].max() == 0.0


def test_skin_weights_change_gradually_along_the_skin():
    body = mannequin()
    edges = mesh_of(body.vertices, body.faces).edges_unique
    length = np.linalg.norm(body.vertices[edges[:, 0]] - body.vertices[edges[:, 1]], axis=1)
    change = np.abs(body.skin_weights[edges[:, 0]] - body.skin_weights[edges[:, 1]]).max(axis=1)
    assert (change / length).max() < 40  # at least 2.5 cm from all to nothing


def test_a_raised_thigh_and_a_bent_knee_take_the_foot_where_the_bones_do():
    foot = mannequin().vertices[:, 1] < 0.05
    left = foot & (mannequin().vertices[:, 0] > 0)
    rest = mannequin().vertices
    moved = posed({"LeftUpLeg": (-90, 0, 0)}) - rest
    assert moved[left][:, 2].min() > 0.6  # forwards
    assert np.abs(moved[foot & ~left]).max() < 1e-5
    bent = posed({"LeftLeg": (90, 0, 0)}) - rest
    assert bent[left][:, 2].max() < -0.2  # the heel goes back
    aside = posed({"RightUpLeg": (0, 0, 40)}) - rest
    assert aside[foot & ~left][:, 0].max() < -0.3  # out to the right


def test_a_high_kick_keeps_most_of_the_bodys_volume():
    rest = mesh_of(mannequin().vertices, mannequin().faces).volume
    kick = mesh_of(posed({"LeftUpLeg": (-90, 0, 20), "LeftLeg": (20, 0, 0)}), mannequin().faces).volume
    assert 0.93 * rest < kick < 1.05 * rest


def test_the_collider_is_closed_and_holds_trunk_and_legs_only():
    body = mannequin()
    collider = mannequin_collider(body)
    points = collider_points(collider, body.vertices)
    mesh = mesh_of(points, collider.faces)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    assert mesh.volume > 0.8 * mesh_of(body.vertices, body.faces).volume
    inside = winding_number(body.joints, points, collider.faces) > 0.5
    names = {name for name, within in zip(JOINT_NAMES, inside, strict=True) if not within}
    assert names == {"Head", "LeftForeArm", "LeftHand", "RightForeArm", "RightHand"}


def test_another_resolution_closes_too():
    body = make_mannequin(0.025)
    assert mesh_of(body.vertices, body.faces).is_watertight
    assert mesh_of(
        body.vertices[mannequin_collider(body).body_vertices], mannequin_collider(body).faces
    ).is_watertight


def test_a_resolution_out_of_range_is_refused():
    with pytest.raises(ValueError, match=r"resolution=0\.1 must lie between 0\.01 and 0\.03 m; try 0\.02"):
        make_mannequin(0.1)
