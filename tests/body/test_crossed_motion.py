"""A motion out of three: every part against the clip that it is taken from."""

import numpy as np
import pytest

from garment_jax.body.crossed_motion import CROSSED, cross_motions
from garment_jax.body.root_frame import heading, yaw_matrix
from garment_jax.structs import Motion
from tests.reference.scene import make_body, make_motion, make_scene

BODY = make_body()


@pytest.fixture(scope="module")
def dances() -> list[Motion]:
    return [make_motion(make_scene(), frames, seed=seed) for frames, seed in ((50, 1), (40, 2), (45, 3))]


def local(motion: Motion, joint: int) -> np.ndarray:
    R = motion.rotations.astype(np.float64)
    return np.swapaxes(R[:, BODY.parents[joint]], -1, -2) @ R[:, joint]


def right_leg() -> list[int]:
    """Found by names, not by the tree that the code walks."""
    return [j for j, name in enumerate(BODY.joint_names) if name.startswith("Right") and "Arm" not in name]


def test_each_joint_turns_against_its_parent_as_in_its_own_clip(dances):
    crossed = cross_motions(*dances, BODY)
    legs = [BODY.joint_names.index(CROSSED)]
    for j, parent in enumerate(BODY.parents.tolist()):
        legs += [j] if parent in legs else []
    for j in range(1, len(BODY.joints)):
        own = dances[1] if j in legs else dances[0]
        np.testing.assert_allclose(local(crossed, j), local(own, j)[:40], atol=1e-5)
    assert {BODY.joint_names[j] for j in legs} <= {BODY.joint_names[j] for j in right_leg()}


def test_the_heading_turns_as_the_third_ones_and_begins_as_the_first_ones(dances):
    crossed = cross_motions(*dances, BODY)
    turned = heading(crossed.rotations[:, 0])
    own, third = heading(dances[0].rotations[:1, 0]), heading(dances[2].rotations[:40, 0])
    np.testing.assert_allclose(np.unwrap(turned), np.unwrap(own[0] + third - third[0]), atol=1e-5)


def test_the_travel_is_the_first_ones_seen_from_the_heading(dances):
    crossed = cross_motions(*dances, BODY)
    np.testing.assert_allclose(crossed.root[:, 1], dances[0].root[:40, 1], atol=1e-9)

    def steps(motion: Motion) -> np.ndarray:
        yaw = yaw_matrix(heading(motion.rotations[:39, 0]))
        return np.einsum("tba,tb->ta", yaw, np.diff(motion.root[:40], axis=0))

    np.testing.assert_allclose(steps(crossed), steps(dances[0]), atol=1e-6)


def test_a_motion_crossed_with_itself_is_itself(dances):
    same = cross_motions(dances[0], dances[0], dances[0], BODY)
    np.testing.assert_allclose(same.rotations, dances[0].rotations, atol=1e-5)
    np.testing.assert_allclose(same.root, dances[0].root, atol=1e-9)


def test_what_cannot_be_crossed_is_refused(dances):
    with pytest.raises(ValueError, match=r"no joint 'Tail'.*Hips"):
        cross_motions(*dances, BODY, joint="Tail")
    with pytest.raises(ValueError, match=r"30, 60 and 30 fps.*resample"):
        cross_motions(dances[0], dances[1]._replace(fps=60.0), dances[2], BODY)
