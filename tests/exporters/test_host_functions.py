"""What a host computes, against the package's own float64 functions on a moving skeleton."""

import jax
import numpy as np
import pytest

from garment_jax.body.kinematics import joint_positions, pose_points
from garment_jax.body.root_frame import to_root, yaw_matrix
from garment_jax.dataset.start import make_skinned_template
from garment_jax.exporters.host_functions import first_frame, frame_input
from garment_jax.geometry.skinning import softmax_weights
from garment_jax.structs import Motion
from tests.animation.tiny_model import CONFIG, JOINTS, SCENE, inputs_of, seeds, template
from tests.reference.scene import make_motion


def turned(degrees: float) -> Motion:
    motion = make_motion(SCENE, 12, legs=1.9)
    Q = yaw_matrix(np.array(np.radians(degrees)))
    return Motion(Q @ motion.rotations, motion.root @ Q.T + [3.0, 0.0, -2.0], motion.fps)


@pytest.mark.parametrize("degrees", [0.0, 137.0, 180.0])
def test_a_frame_is_that_of_the_whole_motion(degrees: float):
    motion = turned(degrees)
    inputs = inputs_of(motion)
    R, root = motion.rotations.astype(np.float32), motion.root.astype(np.float32)
    run = jax.jit(lambda *x: frame_input(SCENE, JOINTS, motion.fps, *x))
    pins = SCENE.pins
    assert pins is not None
    points = SCENE.garment.template[pins.vertices]
    positions = joint_positions(motion.rotations, motion.root, SCENE.body)
    world = pose_points(points, pins.weights, motion.rotations, positions, SCENE.body.joints)
    for t in range(1, len(R)):
        made = jax.tree.map(np.asarray, run(R[t], root[t], R[t - 1], root[t - 1]))
        for name in ("M", "turn", "shift", "R", "t"):
            np.testing.assert_allclose(getattr(made, name), getattr(inputs.x, name)[t], atol=5e-5)
        np.testing.assert_allclose(made.pins @ made.to_world + root[t], world[t], atol=1e-5)
    placed = to_root(world, inputs.root, inputs.yaw)[-1]
    np.testing.assert_allclose(made.pins, placed, atol=1e-5)


def test_the_first_frame_is_the_skinned_template():
    motion = turned(50.0)
    inputs, s, T = inputs_of(motion), seeds(), template().T
    expected = make_skinned_template(T, s, CONFIG.body.tau)(inputs.R_seed[:1], inputs.t_seed[:1])[0]
    W = np.asarray(jax.jit(lambda *x: softmax_weights(*x, tau=CONFIG.body.tau))(T, s.points))
    made = jax.jit(lambda R: first_frame(SCENE, s, T, W, R))(motion.rotations[0].astype(np.float32))
    np.testing.assert_allclose(made, expected, atol=1e-5)


def test_a_body_that_hangs_upside_down_or_stands_still_gives_finite_features():
    R = np.broadcast_to(np.diag([1.0, -1.0, -1.0]), (len(SCENE.body.joints), 3, 3)).astype(np.float32)
    root = np.zeros(3, np.float32)
    made = jax.jit(lambda *x: frame_input(SCENE, JOINTS, 30.0, *x))(R, root, R, root)
    assert all(np.isfinite(leaf).all() for leaf in made)
    np.testing.assert_array_equal(made.turn, np.eye(3))
    np.testing.assert_array_equal(made.shift, np.zeros(3))
