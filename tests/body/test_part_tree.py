"""Joints between parts and the tree through them."""

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.part_tree import common_joint, part_tree
from garment_jax.body.rig_building import joints_near


def test_a_ball_joint_is_found_and_a_hinge_keeps_the_nearest_point_of_its_axis():
    rng = np.random.default_rng(0)
    centre = np.array([0.3, 0.5, -0.2])
    ball = Rotation.from_rotvec(rng.normal(size=(50, 3))).as_matrix() - np.eye(3)
    c, fits = common_joint(ball, -ball @ centre, centre + [0.05, -0.05, 0.02])
    np.testing.assert_allclose(c, centre, atol=1e-3)
    assert fits < 1e-3
    hinge = Rotation.from_euler("x", rng.normal(size=(50, 1))).as_matrix() - np.eye(3)
    c, fits = common_joint(hinge, -hinge @ centre, np.array([0.4, 0.5, -0.2]))
    np.testing.assert_allclose(c, [0.4, 0.5, -0.2], atol=1e-3)
    none, fits = common_joint(0 * ball, np.zeros((50, 3)), centre)
    np.testing.assert_array_equal(none, centre)
    assert fits == 0


def test_a_chain_of_parts_is_a_chain_with_its_middle_as_root():
    rng = np.random.default_rng(1)
    count, frames = 5, 40
    rest = np.stack([np.linspace(0, 5, 101), rng.normal(size=101) * 0.1, rng.normal(size=101) * 0.1], axis=1)
    weights = np.clip(1.5 - 2 * np.abs(rest[:, :1] - (np.arange(count) + 0.5)), 0, 1) + 1e-12
    weights /= weights.sum(axis=1, keepdims=True)
    R = (
        Rotation.from_rotvec(rng.normal(size=(frames * count, 3)) * 0.5)
        .as_matrix()
        .reshape(frames, count, 3, 3)
    )
    T = np.zeros((frames, count, 3))
    for k in range(1, count):  # parts k - 1 and k meet at x = k
        T[:, k] = T[:, k - 1] + (R[:, k - 1] - R[:, k]) @ [k, 0.0, 0.0]
    tree = part_tree(rest, weights, R, T, np.array([2.4, 0, 0]))
    assert tree.order[0] == 2
    assert {(int(tree.order[k]), int(tree.order[tree.parents[k]])) for k in range(1, 5)} == {
        (1, 2), (0, 1), (3, 2), (4, 3)
    }  # fmt: skip
    for k in range(1, 5):
        assert tree.parents[k] < k
        border = max(tree.order[k], tree.order[tree.parents[k]])
        np.testing.assert_allclose(tree.joints[k], [border, 0, 0], atol=5e-3)
    assert tree.mismatch.max() < 1e-2


def test_joints_within_two_steps():
    near = joints_near(np.array([-1, 0, 1, 2, 0]), 2)
    np.testing.assert_array_equal(near[3], [False, True, True, True, False])
    np.testing.assert_array_equal(near[4], [True, True, False, False, True])
