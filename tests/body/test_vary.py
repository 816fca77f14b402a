"""Variations of a motion: each part against a closed form, and what no variation may change."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garment_jax.body.kinematics import joint_positions
from garment_jax.body.root_frame import heading
from garment_jax.body.vary import LEGS, SPIN_RATE, Variation, cut, resampled, vary_motion
from garment_jax.structs import Motion
from tests.reference.scene import make_body, make_motion, make_scene

BODY = make_body()
NOTHING = Variation(tempo=(1.0, 1.0), legs=(1.0, 1.0), turn=(0.0, 0.0), begin=(0.0, 0.0))


def varied(motion: Motion, *, seed: int = 0, **bounds: tuple[float, float]) -> Motion:
    return vary_motion(motion, BODY, np.random.default_rng(seed), variation=NOTHING._replace(**bounds))


@pytest.fixture(scope="module")
def dance() -> Motion:
    return make_motion(make_scene(), 60, seed=3)


def test_without_bounds_to_vary_in_nothing_changes(dance):
    same = varied(dance)
    np.testing.assert_allclose(same.rotations, dance.rotations, atol=1e-6)
    np.testing.assert_allclose(same.root, dance.root, atol=1e-9)


def test_tempo_two_takes_every_other_frame(dance):
    fast = varied(dance, tempo=(2.0, 2.0))
    np.testing.assert_allclose(fast.rotations, dance.rotations[::2], atol=1e-6)
    np.testing.assert_allclose(fast.root, dance.root[::2], atol=1e-9)


def test_between_frames_the_arc_is_the_shortest():
    R = Rotation.from_euler("x", [[0.0], [90.0]], degrees=True).as_matrix()
    rotations = np.repeat(R.astype(np.float32)[:, None], len(BODY.joints), axis=1)
    slow = resampled(Motion(rotations, np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), 30.0), 0.5)
    expected = Rotation.from_euler("x", [[0.0], [45.0], [90.0]], degrees=True).as_matrix()
    np.testing.assert_allclose(slow.rotations[:, 5], expected, atol=1e-6)
    np.testing.assert_allclose(slow.root[:, 0], [0.0, 0.5, 1.0])


def test_knees_bend_by_the_given_part_and_the_upper_body_stays(dance):
    half = varied(dance, legs=(0.5, 0.5))
    names = BODY.joint_names
    thigh, knee = names.index("LeftUpLeg"), names.index("LeftLeg")

    def bend(motion: Motion) -> np.ndarray:
        R = motion.rotations.astype(np.float64)
        local = np.swapaxes(R[:, thigh], -1, -2) @ R[:, knee]
        return Rotation.from_matrix(local).magnitude()

    np.testing.assert_allclose(bend(half), 0.5 * bend(dance), atol=1e-5)
    upper = [names.index(name) for name in ("Hips", "Spine", "Head", "LeftHand")]
    np.testing.assert_allclose(half.rotations[:, upper], dance.rotations[:, upper], atol=1e-6)
    assert set(LEGS) <= set(names)


def test_a_turn_keeps_heights_and_the_length_of_every_step(dance):
    turned = varied(dance, turn=(60.0, 60.0))
    assert np.abs(turned.rotations[30, 0] - dance.rotations[30, 0]).max() > 0.1

    def heights(motion: Motion) -> np.ndarray:
        return joint_positions(motion.rotations.astype(np.float64), motion.root, BODY)[..., 1]

    np.testing.assert_allclose(heights(turned), heights(dance), atol=1e-5)
    step = np.linalg.norm(np.diff(turned.root, axis=0), axis=1)
    np.testing.assert_allclose(step, np.linalg.norm(np.diff(dance.root, axis=0), axis=1), atol=1e-9)


def test_spins_turn_the_whole_body_quickly_and_come_to_rest():
    still = Motion(
        np.broadcast_to(np.eye(3, dtype=np.float32), (600, len(BODY.joints), 3, 3)).copy(),
        np.zeros((600, 3)),
        30.0,
    )
    spun = varied(still, seed=1, spins=(3.0, 3.0))
    angle = np.unwrap(heading(spun.rotations[:, 0].astype(np.float64)))
    rate = np.degrees(np.diff(angle)) * 30.0
    assert 250.0 < np.abs(rate).max() <= 1.01 * SPIN_RATE[1]  # of this seed no two fall together
    assert (np.abs(rate) < 1e-3).any()
    local = np.swapaxes(spun.rotations[:, :1], -1, -2) @ spun.rotations
    np.testing.assert_allclose(local, still.rotations, atol=1e-5)


def test_spins_leave_what_else_a_seed_draws_as_it_was(dance):
    bounds = {"tempo": (0.8, 1.2), "legs": (0.8, 1.2), "turn": (-60.0, 60.0), "begin": (0.0, 0.3)}
    calm, spun = varied(dance, **bounds), varied(dance, **bounds, spins=(30.0, 30.0))

    def local(motion: Motion) -> np.ndarray:
        return np.swapaxes(motion.rotations[:, :1], -1, -2) @ motion.rotations

    np.testing.assert_allclose(local(spun), local(calm), atol=1e-5)
    assert np.abs(spun.rotations - calm.rotations).max() > 0.1


def test_a_later_beginning_leaves_the_rest_alone(dance):
    late = varied(dance, begin=(0.5, 0.5))
    np.testing.assert_allclose(late.rotations, dance.rotations[29:], atol=1e-6)


def test_a_seed_is_a_motion_and_rotations_stay_rotations(dance):
    rng = np.random.default_rng
    one, again = (vary_motion(dance, BODY, rng(5)) for _ in range(2))
    other = vary_motion(dance, BODY, rng(6))
    np.testing.assert_array_equal(one.rotations, again.rotations)
    assert (
        one.rotations.shape != other.rotations.shape or np.abs(one.rotations - other.rotations).max() > 1e-2
    )
    R = one.rotations.astype(np.float64)
    np.testing.assert_allclose(R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-5)


def test_a_cut_is_a_stretch_of_the_motion_and_a_short_motion_stays(dance):
    rng = np.random.default_rng(0)
    firsts = set()
    for _ in range(8):
        part = cut(dance, 30, rng)
        first = int(np.flatnonzero((dance.root == part.root[0]).all(axis=1))[0])
        firsts.add(first)
        np.testing.assert_array_equal(part.rotations, dance.rotations[first : first + 30])
        np.testing.assert_array_equal(part.root, dance.root[first : first + 30])
    assert len(firsts) > 3
    assert cut(dance, None, rng) is dance
    assert cut(dance, len(dance.root), rng) is dance
