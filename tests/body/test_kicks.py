"""Raised legs: where a thigh points at the top, what stays as it was, and bodies without legs."""

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garment_jax.body.kicks import FALL, HIGHEST, RATE, SIDES, kicked
from garment_jax.body.vary import Variation, vary_motion
from garment_jax.structs import Motion
from tests.reference.scene import make_body, make_motion, make_scene

BODY = make_body()
NAMES = list(BODY.joint_names)
FPS = 30.0


def still(frames: int) -> Motion:
    R = np.broadcast_to(np.eye(3, dtype=np.float32), (frames, len(NAMES), 3, 3)).copy()
    return Motion(R, np.zeros((frames, 3)), FPS)


def raised(motion: Motion, side: str) -> np.ndarray:
    """Return degrees between a thigh and straight down, seen from the pelvis, `[t]`."""
    R = motion.rotations.astype(np.float64)
    thigh = np.einsum("tba,tbc->tac", R[:, 0], R[:, NAMES.index(f"{side}UpLeg")])
    return np.degrees(np.arccos(np.clip(thigh[:, 1, 1], -1.0, 1.0)))


def test_legs_are_raised_as_far_and_as_fast_as_is_said_and_come_down():
    motion = kicked(still(9000), BODY, 1.0, np.random.default_rng(0))
    np.testing.assert_allclose(np.linalg.det(motion.rotations[::100]), 1.0, atol=1e-4)
    for side in ("Left", "Right"):
        angle = raised(motion, side)
        assert 80.0 < angle.max() <= max(HIGHEST) + 1.0
        assert np.median(angle) < 1.0
        assert np.abs(np.diff(angle)).max() * FPS < 1.1 * RATE[1] / FALL[0]
        assert (angle > 60.0).sum() > 30


def test_a_kick_goes_to_the_front_to_its_own_side_or_back_but_not_across():
    motion = kicked(still(9000), BODY, 1.0, np.random.default_rng(1))
    R = motion.rotations.astype(np.float64)
    for side, out in (("Left", 1.0), ("Right", -1.0)):
        thigh = np.einsum("tba,tbc->tac", R[:, 0], R[:, NAMES.index(f"{side}UpLeg")])
        down = thigh @ np.array([0.0, -1.0, 0.0])
        assert (out * down[:, 0]).min() > -0.05
        assert down[:, 2].max() > 0.6  # most of them to the front
        assert down[:, 2].min() < -0.05


def single_kicks() -> Iterator[tuple[int, str]]:
    """Yield seeds with which one leg alone is raised, and its side."""
    for seed in range(20):
        motion = kicked(still(400), BODY, 0.9, np.random.default_rng(seed))
        up = [s for s in SIDES if motion.rotations[:, NAMES.index(f"{s}UpLeg"), 1, 1].min() < 0.9]
        if len(up) == 1:
            yield seed, up[0]


def test_the_pelvis_leans_along_and_the_other_leg_stays():
    leans = []
    for seed, side in single_kicks():
        motion = kicked(still(400), BODY, 0.9, np.random.default_rng(seed))
        other = motion.rotations[:, NAMES.index("RightUpLeg" if side == "Left" else "LeftUpLeg")]
        np.testing.assert_allclose(other, np.broadcast_to(np.eye(3), other.shape), atol=1e-5)
        leans.append(np.degrees(Rotation.from_matrix(motion.rotations[:, 0]).magnitude()).max())
    assert len(leans) > 3
    assert max(leans) > 5.0


def test_a_thigh_points_where_the_kick_goes_whatever_it_did_before():
    seed, side = next(single_kicks())
    thigh = NAMES.index(f"{side}UpLeg")
    rest, bent = still(400), still(400)
    bent.rotations[:, thigh] = Rotation.from_rotvec([-0.4, 0.1, 0.2]).as_matrix()
    from_rest, from_bent = (kicked(m, BODY, 0.9, np.random.default_rng(seed)) for m in (rest, bent))
    top = int(raised(from_rest, side).argmax())
    a, b = (motion.rotations[top, thigh] for motion in (from_rest, from_bent))
    np.testing.assert_allclose(a, b, atol=0.05)
    assert np.abs(from_rest.rotations[0, thigh] - from_bent.rotations[0, thigh]).max() > 0.1


def test_without_kicks_nothing_changes_and_without_legs_they_are_refused():
    dance = make_motion(make_scene(), 60, seed=3)
    np.testing.assert_allclose(
        kicked(dance, BODY, 0.0, np.random.default_rng(0)).rotations, dance.rotations, atol=1e-6
    )
    legless = BODY._replace(joint_names=tuple(name.replace("Leg", "Fin") for name in NAMES))
    with pytest.raises(ValueError, match=r"kicks need the joints LeftUpLeg, .* the body has no LeftUpLeg"):
        kicked(dance, legless, 9.0, np.random.default_rng(0))


@pytest.mark.parametrize("kicks", [0.0, 30.0])
def test_kicks_leave_what_else_a_seed_draws_as_it_was(kicks: float):
    dance = make_motion(make_scene(), 60, seed=3)
    calm, made = (
        vary_motion(
            dance, BODY, np.random.default_rng(5), variation=Variation(spins=(9.0, 9.0), kicks=(k, k))
        )
        for k in (0.0, kicks)
    )
    np.testing.assert_allclose(made.root, calm.root, atol=1e-9)
    knee = NAMES.index("LeftLeg")
    assert (np.abs(made.rotations[:, knee] - calm.rotations[:, knee]).max() > 0.1) == (kicks > 0)
