import numpy as np
import pytest

from garment_jax.viewer.posed_body import WEIGHTS, joint_matrices, make_page_body
from tests.reference.scene import make_motion, make_scene, skin


def test_matrices_and_weights_pose_the_body_as_the_reference_does():
    scene = make_scene()
    motion, frames = make_motion(scene, 9), np.array([0, 4, 8])
    page = make_page_body(scene.body, motion, frames)
    matrices = joint_matrices(scene.body, motion, frames).astype(np.float64)
    points = np.concatenate([page.vertices, np.ones((len(page.vertices), 1))], axis=1)
    posed = np.zeros((len(frames), len(points), 3))
    for k in range(WEIGHTS):
        own = matrices[:, page.joints[:, k].astype(int)]
        posed += page.weights[None, :, k, None] * np.einsum("tbrc,bc->tbr", own, points)
    posed += motion.root[frames, None]
    expected = skin(scene.body.vertices, scene.body.skin_weights, motion, scene.body)[frames]
    away = np.linalg.norm(posed - expected, axis=-1).max()
    assert away == pytest.approx(page.error_mm / 1000, abs=2e-6)
    assert page.floor == pytest.approx(expected[..., 1].min(), abs=1e-5)
    assert page.floor + page.height == pytest.approx(expected[..., 1].max(), abs=1e-5)


def test_few_joints_and_weights_that_are_left_out():
    scene = make_scene()
    motion = make_motion(scene, 5)
    spread = np.tile(np.linspace(1, 2, 22, dtype=np.float32), (len(scene.body.vertices), 1))
    many = scene.body._replace(skin_weights=spread / spread.sum(axis=1, keepdims=True))
    page = make_page_body(many, motion, np.arange(5))
    np.testing.assert_allclose(page.weights.sum(axis=1), 1, atol=1e-6)
    assert page.error_mm > 1
    hips = scene.body._replace(
        joints=scene.body.joints[:2],
        parents=scene.body.parents[:2],
        joint_names=scene.body.joint_names[:2],
        skin_weights=np.full((len(scene.body.vertices), 2), 0.5, np.float32),
    )
    two = motion._replace(rotations=motion.rotations[:, :2])
    page = make_page_body(hips, two, np.arange(5))
    assert page.weights.shape[1] == WEIGHTS
    assert page.error_mm < 1e-3
