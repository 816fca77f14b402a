import numpy as np

from garment_jax.body.kinematics import collider_points, joint_positions, pose_body, pose_points
from garment_jax.structs import Collider, Motion
from tests.reference import scene as slow

SCENE = slow.make_scene(5, 8)
MOTION = slow.make_motion(SCENE, 7)


def test_joints_and_skinned_points_are_the_naive_loops():
    positions = joint_positions(MOTION.rotations, MOTION.root, SCENE.body)
    np.testing.assert_allclose(positions, slow.joint_positions(MOTION, SCENE.body), atol=1e-6)
    posed = pose_points(
        SCENE.body.vertices, SCENE.body.skin_weights, MOTION.rotations, positions, SCENE.body.joints
    )
    expected = slow.skin(SCENE.body.vertices, SCENE.body.skin_weights, MOTION, SCENE.body)
    np.testing.assert_allclose(posed, expected, atol=1e-6)


def test_bones_keep_their_length_far_from_the_origin():
    far = MOTION._replace(root=MOTION.root + [1000.0, 0, -1000.0])
    positions = joint_positions(far.rotations, far.root, SCENE.body)
    rest = SCENE.body.joints.astype(float)
    for j in range(1, len(rest)):
        parent = SCENE.body.parents[j]
        length = np.linalg.norm(positions[:, j] - positions[:, parent], axis=1)
        np.testing.assert_allclose(length, np.linalg.norm(rest[j] - rest[parent]), atol=1e-6)


def test_the_canonical_pose_leaves_the_body_where_it_is():
    body = SCENE.body
    still = Motion(
        np.tile(np.eye(3), (2, len(body.joints), 1, 1)), np.repeat(body.joints[:1], 2, axis=0), 30.0
    )
    np.testing.assert_allclose(pose_body(body, still, slice(None)), np.stack([body.vertices] * 2), atol=1e-6)


def test_frames_are_picked_before_they_are_posed():
    some = pose_body(SCENE.body, MOTION, np.array([5, 2]))
    assert some.dtype == np.float32
    np.testing.assert_array_equal(some, pose_body(SCENE.body, MOTION, slice(None))[[5, 2]])


def test_a_cap_vertex_is_the_mean_of_its_loop_and_comes_last():
    vertices = np.arange(24.0).reshape(2, 4, 3)
    capped = Collider(np.array([3, 1]), np.array([0, 1, 2]), np.zeros((0, 3), np.int32))
    points = collider_points(capped, vertices)
    np.testing.assert_array_equal(points[:, 0], vertices[:, 3])
    np.testing.assert_array_equal(points[:, 2], vertices[:, 1])  # the middle one of three
    open_end = capped._replace(cap_loop=np.zeros(0, np.int32))
    assert collider_points(open_end, vertices).shape == (2, 2, 3)
