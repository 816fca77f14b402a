"""The frames before a motion: the canonical pose, a smooth turn of every joint, the first pose."""

import numpy as np
import pytest

from garment_jax.body.preroll import preroll_motion, with_preroll
from garment_jax.body.root_frame import heading, yaw_matrix
from tests.reference.scene import make_motion, make_scene

SCENE = make_scene(4, 8)
MOTION = make_motion(SCENE, 10, seed=5)


def test_it_begins_canonical_where_the_motion_begins():
    before = preroll_motion(MOTION, 90)
    turned = yaw_matrix(heading(MOTION.rotations[:1, 0]))  # the canonical pose faces +Z
    for frame in (0, 20, 40):
        np.testing.assert_allclose(before.rotations[frame], np.tile(turned, (22, 1, 1)), atol=1e-6)
    assert before.fps == MOTION.fps
    np.testing.assert_array_equal(before.root, np.repeat(MOTION.root[:1], 90, axis=0))
    np.testing.assert_allclose(
        heading(before.rotations[:, 0]), heading(MOTION.rotations[:1, 0])[0], atol=1e-3
    )


@pytest.mark.parametrize("frames", [2, 5, 30, 90])
def test_it_ends_in_the_first_pose(frames: int):
    before = preroll_motion(MOTION, frames)
    assert len(before.rotations) == len(before.root) == frames
    np.testing.assert_allclose(before.rotations[-1], MOTION.rotations[0], atol=1e-6)


def test_it_is_continuous_and_made_of_rotations():
    whole = with_preroll(MOTION, 90)
    R = whole.rotations[:91].astype(np.float64)
    np.testing.assert_allclose(R @ np.swapaxes(R, -1, -2), np.tile(np.eye(3), (91, 22, 1, 1)), atol=1e-5)
    relative = np.swapaxes(R[:-1], -1, -2) @ R[1:]
    angle = np.arccos(np.clip((np.trace(relative, axis1=-2, axis2=-1) - 1) / 2, -1, 1))
    total = np.arccos(
        np.clip((np.trace(np.swapaxes(R[0], -1, -2) @ R[-1], axis1=-2, axis2=-1) - 1) / 2, -1, 1)
    )
    assert total.max() > 0.3
    # a smoothstep over 35 frames is at most 1.5 times as fast as a straight blend
    assert (angle.max(axis=0) < 1.6 * total / 35 + 2e-3).all()


def test_the_motion_follows_untouched():
    whole = with_preroll(MOTION, 7)
    np.testing.assert_array_equal(whole.rotations[7:], MOTION.rotations)
    np.testing.assert_array_equal(whole.root[7:], MOTION.root)
    none = with_preroll(MOTION, 0)
    np.testing.assert_array_equal(none.rotations, MOTION.rotations)


def test_a_negative_or_an_endless_length_is_refused():
    with pytest.raises(ValueError, match="--preroll 1000000000000 is hours of motion; give 100000 frames"):
        with_preroll(MOTION, 10**12)
    with pytest.raises(ValueError, match="--preroll -1 is negative; give the number of frames"):
        preroll_motion(MOTION, -1)
