"""The column RNN frame by frame from the skeleton alone, against the package's functions of whole motions."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.body.root_frame import yaw_matrix
from garment_jax.exporters.column_rnn_functions import _radius as radius
from garment_jax.exporters.column_rnn_functions import begun, column_input, corrected, flat, length, unflat
from garment_jax.model.column_rnn.motion import BEFORE, FEATURES, column_frames
from garment_jax.model.column_rnn.tables import make_column_tables
from garment_jax.model.compose import RolloutState, init_state
from garment_jax.model.scan import make_rollout
from garment_jax.model.store import model_input, skinned_template
from garment_jax.structs import Motion
from tests.animation.tiny_model import SCENE, seeds, template
from tests.reference.scene import make_motion
from tests.reference.tiny_column_rnn import COLUMNS, column_rnn_model, tables


def turned(degrees: float, t: int = 14) -> Motion:
    motion = make_motion(SCENE, t, legs=1.9)
    Q = yaw_matrix(np.array(np.radians(degrees)))
    return Motion(Q @ motion.rotations, motion.root @ Q.T + [3.0, 0.0, -2.0], motion.fps)


def skeletons(motion: Motion, t: int) -> tuple[np.ndarray, ...]:
    R, root = motion.rotations.astype(np.float32), motion.root.astype(np.float32)
    return R[t], root[t], R[max(t - 1, 0)], root[max(t - 1, 0)]


@pytest.mark.parametrize("degrees", [0.0, 137.0, 180.0])
def test_a_frame_is_that_of_the_whole_motion(degrees: float):
    motion = turned(degrees)
    expected = column_frames(motion, SCENE, tables())
    state = begun(SCENE, tables(), COLUMNS, jnp.asarray(skeletons(motion, 0)[0]))
    look = jax.jit(partial(column_input, SCENE, tables()))
    assert expected.seen.shape[-1] == FEATURES
    for t in range(14):
        frame, state = look(state, *skeletons(motion, t))
        for name, made in frame._asdict().items():
            np.testing.assert_allclose(made, getattr(expected, name)[t], atol=2e-4, err_msg=f"{name} at {t}")
    assert np.abs(expected.seen[BEFORE:]).max() > 0.5  # it moves, and the body is seen
    assert np.abs(expected.turn).max() > 1e-3


@pytest.mark.parametrize("weight", [1.0, 0.4])
def test_the_codes_are_corrected_as_in_a_rollout(weight: float):
    model, motion = column_rnn_model(), turned(50.0)
    how = replace(model.config.rollout, column_rnn=weight)
    model = model._replace(config=replace(model.config, rollout=how))
    tables_ = template(model)
    inputs = model_input(model, SCENE, tables_, seeds(), motion)
    start = skinned_template(model, tables_, seeds(), inputs)
    state = init_state(model.params, start, template=tables_, config=model.config)
    run = make_rollout(tables_, model.config)
    latents = run(model.params, RolloutState(state.motion), inputs.x)[1]
    expected = run(model.params, state, inputs.x)[1]
    one = jax.jit(partial(corrected, model.params["column_rnn"], SCENE, tables(), model.config))
    state = begun(SCENE, tables(), COLUMNS, jnp.asarray(skeletons(motion, 0)[0]))
    for t in range(14):
        V, state = one(latents[t], state, *skeletons(motion, t))
        np.testing.assert_allclose(V, expected[t], atol=1e-4)
    assert np.abs(np.asarray(expected - latents)).max() > 0.01


def test_a_state_comes_back_from_its_vector():
    R = jnp.asarray(skeletons(turned(10.0), 3)[0])
    state = begun(SCENE, tables(), COLUMNS, R)._replace(age=jnp.full(1, 7.0))
    vector = flat(state)
    assert vector.shape == (length(tables(), COLUMNS),)
    for made, leaf in zip(
        jax.tree.leaves(unflat(vector, tables(), COLUMNS)), jax.tree.leaves(state), strict=True
    ):
        np.testing.assert_array_equal(made, leaf)


def test_a_scene_without_a_collider_sees_no_body():
    scene = SCENE._replace(collider=None)
    ring = make_column_tables(scene, config=COLUMNS)
    expected = column_frames(turned(20.0), scene, ring)
    state = begun(scene, ring, COLUMNS, jnp.asarray(skeletons(turned(20.0), 0)[0]))
    frame, _ = jax.jit(partial(column_input, scene, ring))(state, *skeletons(turned(20.0), 0))
    np.testing.assert_allclose(frame.seen, expected.seen[0], atol=2e-4)


def test_a_point_on_the_axis_has_a_finite_gradient():
    on_axis = jnp.array([[0.0, -0.2, 0.0], [0.1, -0.2, 0.05]])
    gradient = jax.grad(lambda points: radius(points, tables()).sum())(on_axis)
    assert np.isfinite(gradient).all()
