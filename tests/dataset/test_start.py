"""The skinned template: the template itself in the canonical pose, a slow loop in any other."""

import numpy as np

from garment_jax.body.seeds import make_seeds
from garment_jax.dataset.motion_input import motion_input
from garment_jax.dataset.start import make_skinned_template
from garment_jax.structs import Motion
from tests.reference import skinning
from tests.reference.scene import make_motion, make_scene

SCENE = make_scene(5, 8)
SEEDS = make_seeds(SCENE, 6)
T = SCENE.garment.template - SCENE.body.joints[0]
POSE = make_skinned_template(T, SEEDS, 0.1)


def test_in_the_canonical_pose_it_is_the_template():
    still = Motion(np.tile(np.eye(3, dtype=np.float32), (2, 22, 1, 1)), np.ones((2, 3)), 30.0)
    inputs = motion_input(still, SCENE, SEEDS, ("Hips",))
    np.testing.assert_allclose(POSE(inputs.R_seed, inputs.t_seed), np.stack([T, T]), atol=1e-6)


def test_in_any_pose_it_is_the_naive_skinning():
    inputs = motion_input(make_motion(SCENE, 4), SCENE, SEEDS, ("Hips",))
    W = skinning.softmax_weights(T, SEEDS.points, 0.1)
    expected = [skinning.skin(T, W, R, t) for R, t in zip(inputs.R_seed, inputs.t_seed, strict=True)]
    np.testing.assert_allclose(POSE(inputs.R_seed, inputs.t_seed), np.stack(expected), atol=1e-5)
