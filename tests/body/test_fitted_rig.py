"""Rigs fitted to vertices, against a figure whose rig and motion are known."""

import numpy as np
import pytest

from garment_jax.body.fitted_rig import follow, rig_from_vertices
from garment_jax.body.joint_fit import fit_joints
from garment_jax.body.kinematics import joint_positions, pose_body
from tests.body.three_tubes import figure, motion

BODY, MOTION = figure(), motion(40, seed=0)
V = pose_body(BODY, MOTION, slice(None))
FITTED = rig_from_vertices(BODY.faces, V, BODY.vertices, fps=30.0, joints=3)


def same_joints() -> list[int]:
    """The fitted joint of each known one, by the vertices that they carry."""
    return [
        int(FITTED.body.skin_weights[BODY.skin_weights[:, j] > 0.99].sum(axis=0).argmax()) for j in range(3)
    ]


def test_the_fitted_rig_goes_where_the_vertices_went():
    body, found, residual = FITTED
    again = pose_body(body, found, slice(None))
    distance = 100 * np.linalg.norm(again.astype(np.float64) - V, axis=2)
    assert distance.mean() < 0.1
    assert residual.mean == pytest.approx(distance.mean(), rel=1e-4)
    assert residual.largest == pytest.approx(distance.max(), rel=1e-4)
    assert residual.p99 == pytest.approx(np.quantile(distance, 0.99), abs=0.02)
    assert residual.frame == distance.max(axis=1).argmax()
    assert "cm in the mean" in str(residual)


def test_skeleton_joints_weights_and_rotations_are_the_known_ones():
    body, order = FITTED.body, same_joints()
    assert order[0] == 0  # the trunk is nearest to the middle
    assert body.parents.tolist() == [-1, 0, 0]
    assert body.joint_names == ("p0", "p1", "p2")
    np.testing.assert_allclose(body.joints[order][1:], BODY.joints[1:], atol=0.01)
    np.testing.assert_allclose(body.skin_weights[:, order], BODY.skin_weights, atol=0.05)
    np.testing.assert_allclose(body.skin_weights.sum(axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(FITTED.motion.rotations[:, order], MOTION.rotations, atol=0.02)
    np.testing.assert_array_equal(body.vertices, BODY.vertices)
    np.testing.assert_array_equal(body.faces, BODY.faces)


def test_a_known_rig_follows_a_new_clip():
    other = motion(70, seed=5)
    vertices = pose_body(BODY, other, slice(None))
    found = rig_from_vertices(BODY.faces, vertices, BODY.vertices, fps=30.0, rig=FITTED.body)
    assert found.body is FITTED.body
    assert found.residual_cm.mean < 0.2
    exact, residual = follow(BODY, vertices, 30.0)
    assert residual.largest < 0.01
    np.testing.assert_allclose(exact.rotations, other.rotations, atol=1e-3)
    np.testing.assert_allclose(exact.root, other.root, atol=1e-4)
    positions = joint_positions(exact.rotations, exact.root, BODY)
    np.testing.assert_allclose(positions, joint_positions(other.rotations, other.root, BODY), atol=1e-3)


def test_a_body_that_stands_still_is_followed():
    still = np.repeat(BODY.vertices[None], 3, axis=0) + np.float32([0, 0, 50])
    found = rig_from_vertices(BODY.faces, still, BODY.vertices, fps=30.0, joints=2)
    assert found.residual_cm.largest < 0.01
    np.testing.assert_allclose(np.linalg.det(found.motion.rotations), 1, atol=1e-5)


def test_refusals():
    def fit(vertices=V, rest=BODY.vertices, **options):
        rig_from_vertices(BODY.faces, vertices, rest, fps=30.0, **options)

    with pytest.raises(
        ValueError, match=r"moves with shape \(40, 10, 3\) and its rest mesh has 288 vertices"
    ):
        fit(V[:, :10])
    with pytest.raises(ValueError, match="joints=300 does not fit 288 vertices"):
        fit(joints=300)
    with pytest.raises(ValueError, match="use the rest mesh that the rig was fitted to"):
        fit(rest=BODY.vertices + 0.1, rig=BODY)
    broken = V.copy()
    broken[7, 3, 0] = np.inf
    with pytest.raises(ValueError, match="frame 7 holds values that are not finite"):
        fit(broken, rig=BODY)


def test_what_hangs_below_a_joint_moves_with_it():
    chain = BODY._replace(parents=np.array([-1, 0, 1], np.int32))
    vertices = pose_body(chain, MOTION, slice(None))
    found, residual = follow(chain, vertices, 30.0)
    assert residual.largest < 0.01
    np.testing.assert_allclose(found.rotations, MOTION.rotations, atol=1e-3)
    moved = chain._replace(joints=chain.joints + np.float32([[0, 0, 0], [0.02, 0, 0.01], [0, -0.02, 0.01]]))
    joints = moved.joints
    for _ in range(3):
        joints = fit_joints(moved._replace(joints=joints.astype(np.float32)), vertices, MOTION.rotations)
    np.testing.assert_allclose(joints, chain.joints, atol=1e-4)
