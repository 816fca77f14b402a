"""Skinning by the closest body vertex, against the body itself and a NumPy loop."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garment_jax.body.garment_skinning import (
    closest_weights,
    garment_transforms,
    garment_weights,
    joint_transforms,
    turned_less,
)
from garment_jax.body.kinematics import pose_body
from garment_jax.body.root_frame import heading, to_root, yaw_matrix
from garment_jax.geometry.skinning import skin, unskin_frames
from garment_jax.structs import Motion
from tests.animation.tiny_model import SCENE
from tests.baselines.small import MOTION


def test_the_body_skinned_by_joint_transforms_is_the_body() -> None:
    R, t = joint_transforms(MOTION, SCENE)
    body, frame = SCENE.body, 7
    x = body.vertices - body.joints[0]
    expected = np.zeros(x.shape)
    for j in range(len(body.joints)):
        expected += body.skin_weights[:, j : j + 1] * (x @ R[frame, j].T + t[frame, j])
    yaw = heading(MOTION.rotations[:, 0])
    world = pose_body(body, MOTION, slice(None)).astype(np.float64)
    np.testing.assert_allclose(
        expected, to_root(world, MOTION.root.astype(np.float64), yaw)[frame], atol=1e-5
    )
    np.testing.assert_allclose(jax.jit(skin)(x, body.skin_weights, R[frame], t[frame]), expected, atol=1e-5)


def test_weights_are_those_of_the_closest_vertex_that_the_cloth_can_touch() -> None:
    assert SCENE.collider is not None
    W = closest_weights(SCENE)
    allowed = SCENE.collider.body_vertices
    for i in (0, 40, 127):
        away = [np.linalg.norm(SCENE.body.vertices[k] - SCENE.garment.template[i]) for k in allowed]
        np.testing.assert_array_equal(W[i], SCENE.body.skin_weights[allowed[int(np.argmin(away))]])


def test_unposing_undoes_posing() -> None:
    R, t = joint_transforms(MOTION, SCENE)
    W = closest_weights(SCENE)
    T = SCENE.garment.template - SCENE.body.joints[0]
    posed = jax.jit(jax.vmap(skin, (None, None, 0, 0)))(T, W, R, t)
    back = np.asarray(unskin_frames(posed, W, R, t))
    np.testing.assert_allclose(back, np.broadcast_to(T, back.shape), atol=1e-4)


def test_a_symmetric_garments_weights_are_the_same_left_and_right():
    W = garment_weights(SCENE, reach=0.1, mirrored=True)
    np.testing.assert_allclose(W.sum(axis=1), 1.0, atol=1e-6)
    names = SCENE.body.joint_names
    left, right = names.index("LeftUpLeg"), names.index("RightUpLeg")
    T = SCENE.garment.template
    for i in range(0, len(T), 9):
        partner = int(np.argmin(np.linalg.norm(T * [-1, 1, 1] - T[i], axis=1)))
        assert W[i, left] == pytest.approx(W[partner, right], abs=1e-6)
    plain = closest_weights(SCENE)
    assert np.ptp(W[:, left]) < np.ptp(plain[:, left])  # smoother than the body's own


def test_a_lopsided_garment_has_no_mirrored_weights():
    T = SCENE.garment.template.copy()
    T[T[:, 0] > 0] *= [1.3, 1, 1]
    scene = SCENE._replace(garment=SCENE.garment._replace(template=T, uv=SCENE.garment.uv**2))
    with pytest.raises(ValueError, match="not left-right symmetric"):
        garment_weights(scene, reach=0.1, mirrored=True)
    assert garment_weights(scene, reach=0.1, mirrored=False).shape == (len(T), len(SCENE.body.joints))


@pytest.mark.parametrize("less", [0.0, 35.0, 60.0])
def test_rotations_are_turned_less_about_their_own_axes(less: float):
    rng = np.random.default_rng(2)
    axes = rng.normal(size=(60, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = np.radians(np.linspace(0.0, 179.0, 60))
    made = turned_less(Rotation.from_rotvec(axes * angles[:, None]).as_matrix(), np.radians(less))
    kept = np.maximum(angles - np.radians(less), 0.0)
    expected = Rotation.from_rotvec(axes * kept[:, None]).as_matrix()
    np.testing.assert_allclose(made, expected, atol=1e-7)


def test_half_a_turn_stays_finite():
    made = turned_less(np.stack([np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, -1.0, 1.0])]), 1.0)
    assert np.abs(made).max() <= 1.0


def test_without_a_free_angle_the_garments_transforms_are_the_joints():
    for made, expected in zip(
        garment_transforms(MOTION, SCENE, free_angle=0.0), joint_transforms(MOTION, SCENE), strict=True
    ):
        np.testing.assert_allclose(made, expected, atol=1e-6)


def test_a_body_that_stands_and_faces_anywhere_carries_nothing():
    turn = yaw_matrix(np.array(0.8))
    still = Motion(np.tile(turn, (2, len(SCENE.body.joints), 1, 1)), np.ones((2, 3)), 30.0)
    R, t = garment_transforms(still, SCENE)
    np.testing.assert_array_equal(R, np.broadcast_to(np.eye(3), R.shape))
    np.testing.assert_allclose(t, 0.0, atol=1e-7)
