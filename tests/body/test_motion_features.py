import numpy as np
import pytest

from garment_jax.body.motion_features import (
    backward_velocity,
    chosen_joints,
    feature_names,
    joint_indices,
    motion_features,
)
from garment_jax.body.root_frame import heading, yaw_matrix
from garment_jax.structs import Motion
from tests.reference import scene as slow

SCENE = slow.make_scene(5, 8)
MOTION = slow.make_motion(SCENE, 12)
NAMES = ("Hips", "LeftUpLeg", "LeftLeg")


def features(motion: Motion) -> dict[str, np.ndarray]:
    M = motion_features(motion, SCENE.body, NAMES)
    assert M.dtype == np.float32
    assert M.shape == (len(motion.root), 10 + 12 * len(NAMES))
    return dict(zip(feature_names(NAMES), M.T, strict=True))


def test_every_number_is_that_of_a_slow_loop():
    found = features(MOTION)
    body, R = SCENE.body, MOTION.rotations.astype(float)
    positions = slow.joint_positions(MOTION, body)
    yaw = np.unwrap(heading(R[:, 0]))
    for t in range(len(R)):
        now, before = max(t, 1), max(t, 1) - 1
        # the difference is that of frames 0 and 1 in frame 0 too, seen from frame 0
        turn = yaw_matrix(-yaw[t, None])[0]
        tilt = (turn @ R[t, 0])[:, :2].ravel()
        np.testing.assert_allclose([found[f"root tilt {k}"][t] for k in range(6)], tilt, atol=1e-5)
        assert found["root yaw rate rad/s"][t] == pytest.approx((yaw[now] - yaw[before]) * 30, abs=1e-4)
        velocity = turn @ (MOTION.root[now] - MOTION.root[before]) * 30
        np.testing.assert_allclose([found[f"root velocity {a} m/s"][t] for a in "xyz"], velocity, atol=1e-4)
        for name in NAMES:
            j = body.joint_names.index(name)
            relative = R[t, max(body.parents[j], 0)].T @ R[t, j]
            numbers = [found[f"{name} rotation {k}"][t] for k in range(6)]
            np.testing.assert_allclose(numbers, relative[:, :2].ravel(), atol=1e-5)
            place = turn @ (positions[t, j] - MOTION.root[t])
            np.testing.assert_allclose([found[f"{name} position {a} m"][t] for a in "xyz"], place, atol=1e-5)
            speed = turn @ (positions[now, j] - positions[before, j]) * 30
            numbers = [found[f"{name} velocity {a} m/s"][t] for a in "xyz"]
            np.testing.assert_allclose(numbers, speed, atol=2e-4)


def test_the_future_does_not_change_the_past():
    M = motion_features(MOTION, SCENE.body, NAMES)
    rng = np.random.default_rng(0)
    rotations, root = MOTION.rotations.copy(), MOTION.root.copy()
    rotations[6:] = rotations[rng.permutation(6)]
    root[6:] += rng.normal(size=(6, 3))
    changed = motion_features(Motion(rotations, root, 30.0), SCENE.body, NAMES)
    np.testing.assert_array_equal(changed[:6], M[:6])
    assert np.abs(changed[6] - M[6]).max() > 1e-3


def test_velocities_are_backward_per_second_and_frame_0_takes_its_successors():
    x = np.array([[0.0], [0.1], [0.4]])
    np.testing.assert_allclose(backward_velocity(x, 30.0), [[3.0], [3.0], [9.0]])
    np.testing.assert_allclose(backward_velocity(x, 60.0), [[6.0], [6.0], [18.0]])
    np.testing.assert_array_equal(backward_velocity(x[:1], 30.0), [[0.0]])


def test_turning_steadily_past_half_a_turn_gives_a_steady_yaw_rate():
    frames = 30
    body = SCENE.body
    rotations = np.repeat(yaw_matrix(0.5 * np.arange(frames))[:, None], len(body.joints), axis=1)
    found = features(Motion(rotations, np.zeros((frames, 3)), 30.0))
    np.testing.assert_allclose(found["root yaw rate rad/s"], 15.0, rtol=1e-5)
    np.testing.assert_allclose(found["root tilt 0"], 1, atol=1e-6)


def test_velocities_do_not_lose_digits_far_from_the_origin():
    far = motion_features(MOTION._replace(root=MOTION.root + 1e4), SCENE.body, NAMES)
    np.testing.assert_allclose(far, motion_features(MOTION, SCENE.body, NAMES), atol=1e-5)


def test_a_missing_joint_is_refused_with_the_bodys_joints():
    with pytest.raises(ValueError, match=r"no joint 'Tail'; it has Hips, .*body\.motion_joints"):
        joint_indices(SCENE.body, ("Hips", "Tail"))


def test_all_stands_for_every_joint_but_the_root():
    names = chosen_joints(SCENE.body, ("all",))
    assert names == SCENE.body.joint_names[1:]
    np.testing.assert_array_equal(
        motion_features(MOTION, SCENE.body, ("all",)), motion_features(MOTION, SCENE.body, names)
    )
    assert chosen_joints(SCENE.body, NAMES) == NAMES
