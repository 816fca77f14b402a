"""Pins and collider, posed together, against the body posed whole."""

import numpy as np

from garment_jax.body.carried import carried_points, pose_carried
from garment_jax.body.kinematics import collider_points, joint_positions, pose_body, pose_points
from garment_jax.body.limbs import limbs_of
from garment_jax.body.root_frame import heading, to_root
from tests.reference.scene import make_motion, make_scene

SCENE = make_scene()
MOTION = make_motion(SCENE, 9, seed=1)
FRAMES = slice(2, 7)


def test_pins_and_collider_are_those_of_the_posed_body():
    assert SCENE.pins is not None
    assert SCENE.collider is not None
    frame = MOTION.root[FRAMES], heading(MOTION.rotations[FRAMES, 0])
    carried = carried_points(SCENE, collider=True)
    pins, collider, _ = pose_carried(carried, SCENE, MOTION, FRAMES)
    body = pose_body(SCENE.body, MOTION, np.arange(FRAMES.start, FRAMES.stop))
    whole = to_root(collider_points(SCENE.collider, body), *frame)
    np.testing.assert_allclose(collider, whole, atol=1e-6)
    rotations = MOTION.rotations[FRAMES]
    positions = joint_positions(rotations, MOTION.root[FRAMES], SCENE.body)
    points = SCENE.garment.template[SCENE.pins.vertices]
    posed = pose_points(points, SCENE.pins.weights, rotations, positions, SCENE.body.joints)
    np.testing.assert_allclose(pins, to_root(posed, *frame), atol=1e-6)


def test_what_a_scene_lacks_is_left_out():
    bare = SCENE._replace(collider=None, pins=None)
    for scene, collider, shapes in (
        (bare, True, ((5, 0, 3), (5, 0, 3), (5, 0, 2, 3))),
        (SCENE, False, ((5, 16, 3), (5, 0, 3), (5, 0, 2, 3))),
    ):
        parts = pose_carried(carried_points(scene, collider=collider), scene, MOTION, FRAMES)
        assert tuple(part.shape for part in parts) == shapes


def test_bones_end_at_the_posed_joints():
    assert SCENE.collider is not None
    limbs = limbs_of(SCENE.body, SCENE.collider)
    bones = pose_carried(carried_points(SCENE, collider=True, limbs=limbs), SCENE, MOTION, FRAMES).bones
    root = MOTION.root[FRAMES]
    joints = joint_positions(MOTION.rotations[FRAMES], root, SCENE.body)
    placed = to_root(joints, root, heading(MOTION.rotations[FRAMES, 0]))
    np.testing.assert_allclose(bones, placed[:, limbs.joints], atol=1e-6)
    alone = carried_points(SCENE._replace(pins=None), collider=False, limbs=limbs)
    np.testing.assert_array_equal(pose_carried(alone, SCENE, MOTION, FRAMES).bones, bones)
