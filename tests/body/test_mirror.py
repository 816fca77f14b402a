import numpy as np
import pytest

from garment_jax.body.kinematics import joint_positions
from garment_jax.body.mirror import FLIP, mirror_motion
from tests.reference.scene import make_motion, make_scene

SCENE = make_scene(5, 8)
MOTION = make_motion(SCENE, 9)


def test_mirroring_twice_is_the_identity():
    twice = mirror_motion(mirror_motion(MOTION, SCENE.body), SCENE.body)
    np.testing.assert_array_equal(twice.rotations, MOTION.rotations)
    np.testing.assert_array_equal(twice.root, MOTION.root)
    assert twice.fps == MOTION.fps


def test_the_mirrored_motions_joints_are_the_mirrored_joints():
    body = SCENE.body
    mirrored = mirror_motion(MOTION, body)
    here = joint_positions(MOTION.rotations, MOTION.root, body)
    there = joint_positions(mirrored.rotations, mirrored.root, body)
    swap = {"Left": "Right", "Right": "Left"}
    for j, name in enumerate(body.joint_names):
        side = next((s for s in swap if name.startswith(s)), None)
        partner = body.joint_names.index(name.replace(side, swap[side])) if side else j
        np.testing.assert_allclose(there[:, partner], here[:, j] * FLIP, atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(mirrored.rotations), 1, atol=1e-5)
    assert np.abs(there - here).max() > 0.1


def test_a_joint_without_a_partner_is_refused():
    names = tuple("LeftPaw" if name == "LeftFoot" else name for name in SCENE.body.joint_names)
    with pytest.raises(ValueError, match=r"'LeftPaw' has no partner 'RightPaw'; set data\.mirror = false"):
        mirror_motion(MOTION, SCENE.body._replace(joint_names=names))


def test_a_lopsided_skeleton_is_refused():
    joints = SCENE.body.joints.copy()
    joints[SCENE.body.joint_names.index("LeftFoot"), 0] += 0.05
    with pytest.raises(ValueError, match=r"differ by 5\.0 cm\); set data\.mirror = false"):
        mirror_motion(MOTION, SCENE.body._replace(joints=joints))
