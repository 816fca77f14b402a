import numpy as np
import pytest

from garment_jax.body.looped_motion import BLEND, looped_motion
from garment_jax.body.root_frame import heading, yaw_matrix
from garment_jax.structs import Motion
from tests.reference.scene import make_motion, make_scene

SCENE = make_scene()
MOTION = make_motion(SCENE, 60)
PERIOD = 60 - BLEND
LOOPED = looped_motion(MOTION, 3 * PERIOD)


def local(motion: Motion) -> np.ndarray:
    """Return the rotations without their heading."""
    return yaw_matrix(-heading(motion.rotations[:, 0]))[:, None] @ motion.rotations.astype(np.float64)


def test_poses_and_heights_repeat():
    poses = local(LOOPED)
    np.testing.assert_allclose(poses[PERIOD : 2 * PERIOD], poses[:PERIOD], atol=1e-6)
    np.testing.assert_allclose(LOOPED.root[PERIOD : 2 * PERIOD, 1], LOOPED.root[:PERIOD, 1])
    np.testing.assert_allclose(poses[BLEND:PERIOD], local(MOTION)[BLEND:PERIOD], atol=1e-6)


def test_the_seam_is_no_faster_than_the_clip():
    def fastest(motion: Motion) -> tuple[float, float]:
        root = np.linalg.norm(np.diff(motion.root, axis=0), axis=1).max()
        return root, np.abs(np.diff(motion.rotations, axis=0)).max()

    for seam, clip in zip(fastest(LOOPED), fastest(MOTION), strict=True):
        assert seam < 1.5 * clip


def test_a_clip_as_short_as_two_seams_is_refused():
    with pytest.raises(ValueError, match="a clip of 30 frames is too short to blend 15; take a longer one"):
        looped_motion(make_motion(SCENE, 2 * BLEND), 100)
