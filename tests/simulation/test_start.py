"""The frames before a clip: canonical, blended, held; and the drape put where the clip begins."""

import numpy as np
import pytest

from garment_jax.body.root_frame import heading, yaw_matrix
from garment_jax.simulation.settings import ClothSettings
from garment_jax.simulation.start import ClothState, canonical_motion, start_motion, to_world
from tests.reference.scene import make_motion, make_scene

SCENE = make_scene(4, 8)
MOTION = make_motion(SCENE, 6, seed=5)
SETTINGS = ClothSettings(settle=4, blend=5, hold=3)


def test_it_settles_blends_and_holds_where_the_clip_begins():
    start = start_motion(MOTION, SCENE.body, SETTINGS)
    yaw = yaw_matrix(heading(MOTION.rotations[:1, 0]))
    assert len(start.rotations) == len(start.root) == 12
    np.testing.assert_allclose(start.rotations[:4], np.tile(yaw, (4, 22, 1, 1)), atol=1e-6)
    np.testing.assert_allclose(start.rotations[8:], np.tile(MOTION.rotations[0], (4, 1, 1, 1)), atol=1e-6)
    np.testing.assert_array_equal(start.root, np.repeat(MOTION.root[:1], 12, axis=0))


def test_it_turns_in_from_the_canonical_heading_and_height():
    start = start_motion(MOTION, SCENE.body, ClothSettings(settle=4, blend=5, hold=3, turn_in=True))
    np.testing.assert_allclose(start.rotations[:4], np.tile(np.eye(3), (4, 22, 1, 1)), atol=1e-6)
    np.testing.assert_allclose(start.rotations[8:], np.tile(MOTION.rotations[0], (4, 1, 1, 1)), atol=1e-6)
    np.testing.assert_array_equal(start.root[:, [0, 2]], np.repeat(MOTION.root[:1, [0, 2]], 12, axis=0))
    np.testing.assert_allclose(start.root[:4, 1], SCENE.body.joints[0, 1], atol=1e-7)
    np.testing.assert_allclose(start.root[8:, 1], MOTION.root[0, 1], atol=1e-7)
    middle = 0.5 * (SCENE.body.joints[0, 1] + MOTION.root[0, 1])
    half = start_motion(MOTION, SCENE.body, ClothSettings(settle=0, blend=2, hold=0, turn_in=True))
    np.testing.assert_allclose(half.root[0, 1], middle, atol=1e-7)
    turned = heading(half.rotations[:, 0])  # slerp of the root: half of its turn half-way
    np.testing.assert_allclose(turned[0], 0.5 * turned[1], atol=0.05)


def test_the_blend_begins_and_ends_slowly():
    start = start_motion(MOTION, SCENE.body, ClothSettings(settle=1, blend=20, hold=1)).rotations
    j = SCENE.body.joint_names.index("LeftLeg")
    step = np.linalg.norm(np.diff(start[:, j], axis=0), axis=(1, 2))
    assert step[0] < 0.1 * step[10]
    assert step[19] < 0.1 * step[10]
    assert (np.diff(step[:10]) > 0).all()


def test_parts_may_be_left_out():
    start = start_motion(MOTION, SCENE.body, ClothSettings(settle=0, blend=0, hold=2))
    np.testing.assert_allclose(start.rotations[0], MOTION.rotations[0], atol=1e-6)
    assert len(start_motion(MOTION, SCENE.body, ClothSettings(settle=0, blend=0, hold=0)).root) == 0


def test_the_canonical_motion_is_the_canonical_pose():
    motion = canonical_motion(SCENE.body, 3, 30.0)
    np.testing.assert_array_equal(motion.rotations, np.tile(np.eye(3), (3, 22, 1, 1)))


def test_a_drape_is_turned_and_carried():
    state = ClothState(np.array([[0, 0, 1]], np.float32), np.array([[1, 2, 0]], np.float32))
    world = to_world(state, np.array([10.0, 0.0, 0.0]), np.pi / 2)  # +Z turns to +X, +X to -Z
    np.testing.assert_allclose(world.positions, [[11, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(world.velocities, [[0, 2, -1]], atol=1e-6)


@pytest.mark.parametrize(
    ("motion", "match"),
    [
        (MOTION._replace(root=MOTION.root[:0], rotations=MOTION.rotations[:0]), "no frames"),
        (MOTION._replace(rotations=MOTION.rotations[:, :5]), "turns 5 joints and the body has 22"),
        (MOTION._replace(fps=60.0), "60 fps, the settings 30; resample"),
    ],
)
def test_motions_that_do_not_fit_are_refused(motion, match: str):
    with pytest.raises(ValueError, match=match):
        start_motion(motion, SCENE.body, SETTINGS)
