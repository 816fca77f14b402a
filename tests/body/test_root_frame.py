import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garment_jax.body.root_frame import carry_over, from_root, heading, to_root, yaw_matrix


def walk(frames: int = 6, seed: int = 0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(frames, 9, 3)), rng.normal(size=(frames, 3)), rng.uniform(-9, 9, frames)


def test_yaw_turns_z_towards_x():
    np.testing.assert_allclose(yaw_matrix(np.array(np.pi / 2)) @ [0, 0, 1], [1, 0, 0], atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1.0, -2.0, np.radians(137)])
def test_turning_the_world_adds_exactly_that_to_the_heading_whatever_the_tilt(angle):
    tilts = Rotation.random(50, random_state=0).as_matrix()
    tilts = tilts[np.abs(np.trace(tilts, axis1=1, axis2=2) - 2 * tilts[:, 1, 1] + 1) > 0.2]
    added = heading(yaw_matrix(np.array(angle)) @ tilts) - heading(tilts)
    np.testing.assert_allclose(np.exp(1j * added), np.exp(1j * angle), atol=1e-6)


def test_a_pure_tilt_has_no_heading_and_a_hanging_root_gets_0():
    np.testing.assert_allclose(heading(Rotation.from_euler("x", [[0.8]]).as_matrix()), 0, atol=1e-12)
    assert heading(np.diag([1.0, -1, -1])[None]) == 0


def test_to_root_undoes_the_heading_and_from_root_undoes_to_root():
    points, root, yaw = walk()
    local = to_root(points, root, yaw)
    for t in range(len(root)):
        expected = (yaw_matrix(-yaw[t, None])[0] @ (points[t] - root[t]).T).T
        np.testing.assert_allclose(local[t], expected, atol=1e-12)
    np.testing.assert_allclose(from_root(local, root, yaw), points, atol=1e-12)


def test_float32_points_stay_float32_on_the_way_back():
    points, root, yaw = walk()
    local = to_root(points, root, yaw).astype(np.float32)
    world = from_root(local, root, yaw)
    assert world.dtype == np.float32
    np.testing.assert_allclose(world, points, atol=1e-5)


def test_carry_over_re_expresses_the_last_frame():
    points, root, yaw = walk()
    turn, shift = carry_over(root, yaw)
    local = to_root(points, root, yaw)
    for t in range(1, len(root)):
        expected = to_root(points[t - 1 : t], root[t : t + 1], yaw[t : t + 1])[0]
        np.testing.assert_allclose(local[t - 1] @ turn[t] + shift[t], expected, atol=2e-6)
    np.testing.assert_array_equal(turn[0], np.eye(3))
    np.testing.assert_array_equal(shift[0], 0)


def test_carry_over_is_exact_a_kilometre_away():
    _, root, yaw = walk()
    for near, far in zip(carry_over(root, yaw), carry_over(root + [1000.0, 0, 1000], yaw), strict=True):
        np.testing.assert_allclose(near, far, atol=1e-6)
