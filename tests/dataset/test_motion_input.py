import jax
import numpy as np
import pytest

from garment_jax.body.root_frame import yaw_matrix
from garment_jax.body.seeds import make_seeds
from garment_jax.dataset.motion_input import motion_input
from garment_jax.structs import Motion
from tests.reference.scene import make_motion, make_scene

SCENE = make_scene(5, 8)
MOTION = make_motion(SCENE, 12)
SEEDS = make_seeds(SCENE, 6)
JOINTS = ("Hips", "LeftUpLeg", "RightUpLeg")


def moved(motion: Motion, angle: float, shift: list[float]) -> Motion:
    """The whole motion turned about the up axis and then moved."""
    turn = yaw_matrix(np.array(angle))
    return Motion(turn @ motion.rotations, motion.root @ turn.T + shift, motion.fps)


@pytest.mark.parametrize(
    ("angle", "shift"),
    [(0.0, [100.0, 0, 0]), (np.radians(137), [0.0, 0, 0]), (np.radians(137), [60.0, 0, -80])],
)
def test_moving_100_m_and_turning_137_degrees_changes_nothing(angle, shift):
    here = motion_input(MOTION, SCENE, SEEDS, JOINTS)
    there = motion_input(moved(MOTION, angle, shift), SCENE, SEEDS, JOINTS)
    for name in ("M", "turn", "shift"):
        np.testing.assert_allclose(getattr(there.x, name), getattr(here.x, name), atol=1e-4, err_msg=name)
    np.testing.assert_allclose(there.R_seed, here.R_seed, atol=1e-4)
    np.testing.assert_allclose(there.t_seed, here.t_seed, atol=1e-4)
    turned = (there.yaw - here.yaw - angle + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(turned, 0, atol=1e-6)


def test_lifting_the_motion_changes_nothing_either():
    here, there = (motion_input(m, SCENE, SEEDS, JOINTS) for m in (MOTION, moved(MOTION, 0.0, [0, 3.0, 0])))
    np.testing.assert_allclose(there.x.M, here.x.M, atol=1e-4)


def test_a_joint_that_the_body_lacks_is_refused():
    with pytest.raises(ValueError, match="no joint 'Wing'"):
        motion_input(MOTION, SCENE, SEEDS, ("Hips", "Wing"))


def test_shapes_and_types():
    found = motion_input(MOTION, SCENE, SEEDS, JOINTS)
    assert found.x.M.shape == (12, 10 + 12 * 3)
    assert found.R_seed.shape == (12, 6, 3, 3)
    assert found.t_seed.shape == (12, 6, 3)
    assert {a.dtype for a in jax.tree.leaves((found.x, found.R_seed, found.t_seed))} == {np.dtype(np.float32)}
    assert found.root.dtype == found.yaw.dtype == np.float64
