import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from garment_jax.body.garment_skinning import garment_weights
from garment_jax.config import TrainingConfig
from garment_jax.model.motion.network import MotionCarry
from garment_jax.model.motion.train_step import (
    begin_lanes,
    empty_carry,
    make_motion_train_step,
    noisy_gates,
)
from garment_jax.structs import TrainState
from garment_jax.training.optimiser import make_optimiser
from tests.reference import skinning
from tests.reference.laplacian import uniform_laplacian
from tests.reference.motion_window import LANES, W, frozen, motion_params, one_frame, window
from tests.reference.small_model import GENERATIVE, MOTION, fast_key, small_model

N = len(small_model().template.T)
STEPS = 80
OPTIMISER = make_optimiser(
    TrainingConfig(schedule="constant", warmup=0.0), learning_rate=1e-2, weight_decay=0.01, steps=STEPS
)
# without the latent term every gradient has come through the frozen decoders
CONFIG = dataclasses.replace(MOTION, lambda_latent=0.0)


@pytest.fixture(scope="module")
def step():
    """The train step, compiled once: the metrics are those of the parameters that it was given."""
    return make_motion_train_step(small_model().template, frozen()[0], CONFIG, GENERATIVE, OPTIMISER)


def first_state(carry: MotionCarry | None = None) -> TrainState:
    params = jax.tree.map(jnp.array, motion_params())  # a copy: the step donates
    carry = empty_carry(LANES, N, MOTION) if carry is None else jax.tree.map(jnp.array, carry)
    return TrainState(params, OPTIMISER.init(params), fast_key(5), jnp.int32(0), carry)


def run(step, batch, carry=None) -> tuple[TrainState, dict[str, float]]:
    state, metrics = step(first_state(carry), batch)
    return state, {name: float(value) for name, value in metrics.items()}


def python_loop(frames: int, first: int = 1):
    """The same lanes one frame after the other: carries and latents of every frame, by lane."""
    model = small_model()
    carries, latents = [], []
    for start in (first, first + 15):
        carry = MotionCarry(jnp.zeros(MOTION.gru), jnp.asarray(model.V[start - 1]))
        for t in range(start, start + frames):
            x = jax.tree.map(jnp.asarray, model.input.frame(t))
            carry, Z = one_frame(motion_params(), frozen()[0], carry, x)
            carries.append(carry)
            latents.append(Z)
    return carries, latents


def test_the_scan_over_frames_is_a_python_loop_and_its_loss_the_mean_over_frames_and_lanes(step):
    batch = window()
    state, metrics = run(step, batch)
    carries, _ = python_loop(W)
    faces = small_model().scene.garment.faces
    vertex, rough = [], []
    for i, after in enumerate(carries):
        lane, t = divmod(i, W)
        E = 100 * (np.asarray(after.V_prev, float) - np.asarray(batch.V_star[t, lane]))
        vertex.append((E**2).sum() / N)
        rough.append(1.5 * (uniform_laplacian(E, faces) ** 2).sum() / N)
    for lane in range(LANES):
        np.testing.assert_allclose(state.carry.V_prev[lane], carries[lane * W + W - 1].V_prev, atol=1e-5)
        np.testing.assert_allclose(state.carry.h[lane], carries[lane * W + W - 1].h, atol=1e-5)
    assert metrics["vertex"] == pytest.approx(np.mean(vertex), rel=1e-3)
    assert metrics["laplacian"] == pytest.approx(np.mean(rough), rel=1e-3)
    assert metrics["latent"] == 0
    assert metrics["loss"] == pytest.approx(np.mean(vertex) + np.mean(rough), rel=1e-3)
    assert metrics["rmse_cm"] == pytest.approx(np.sqrt(np.mean(vertex)), rel=1e-3)


def test_two_windows_in_a_row_are_one_long_one(step):
    state, _ = run(step, window())
    state, _ = run(step, window(1 + W, fresh=False), state.carry)
    carries, _ = python_loop(2 * W)
    for lane in range(LANES):
        last = carries[(lane + 1) * 2 * W - 1]
        np.testing.assert_allclose(state.carry.V_prev[lane], last.V_prev, atol=1e-5)


def test_the_gradient_is_cut_at_the_border_of_a_window():
    batch = window(fresh=False)
    carry = MotionCarry(jnp.ones((LANES, MOTION.gru)), jnp.ones((LANES, N, 3)))
    gradient = jax.grad(lambda c: sum(leaf.sum() for leaf in begin_lanes(c, batch)))(carry)
    assert all(np.abs(leaf).max() == 0 for leaf in gradient)


def test_fresh_lanes_begin_anew_and_the_others_go_on():
    batch = window()._replace(fresh=jnp.array([True, False]))
    old = MotionCarry(jnp.ones((LANES, MOTION.gru)), jnp.full((LANES, N, 3), 2.0))
    new = begin_lanes(old, batch)
    np.testing.assert_array_equal(new.h, [np.zeros(MOTION.gru), np.ones(MOTION.gru)])
    np.testing.assert_array_equal(new.V_prev[0], batch.V_start[0])
    np.testing.assert_array_equal(new.V_prev[1], 2.0)


def test_a_frame_without_weight_does_not_count(step):
    batch = window()
    weight = batch.weight.at[:2, 1].set(0.0)
    wild = batch.V_star.at[:2, 1].add(1.0)
    loss = run(step, batch._replace(weight=weight))[1]["loss"]
    assert run(step, batch._replace(weight=weight, V_star=wild))[1]["loss"] == pytest.approx(loss, rel=1e-5)
    assert run(step, batch._replace(V_star=wild))[1]["loss"] > 2 * loss


def test_gradients_reach_every_encoder_through_the_frozen_decoders(step):
    state, metrics = run(step, window())
    assert np.isfinite(metrics["gradient_norm"])
    moments = optax.tree_utils.tree_get(state.opt_state, "mu")
    for name in ("dense", "gru_x", "gru_h", "fc", "E_s"):
        assert max(float(np.abs(leaf).max()) for leaf in jax.tree.leaves(moments[name])) > 0, name


def test_one_window_is_overfitted_and_the_frozen_parameters_get_neither_updates_nor_decay(step):
    before = jax.tree.map(np.array, frozen()[0])
    state, losses = first_state(), []
    for _ in range(STEPS):
        state, metrics = step(state, window())
        losses.append(float(metrics["loss"]))
    assert losses[-1] < 0.15 * losses[0]
    assert metrics["rmse_cm"] < 4
    assert state.step == STEPS
    jax.tree.map(np.testing.assert_array_equal, jax.tree.map(np.array, frozen()[0]), before)
    numbers = sum(leaf.size for leaf in jax.tree.leaves(motion_params()))
    kept = sum(leaf.size for leaf in jax.tree.leaves(state.opt_state) if leaf.ndim)
    assert kept == 2 * numbers  # Adam's two moments of the encoder's own parameters and no more


def test_hidden_features_are_hidden_for_a_lanes_whole_window_and_noise_is_added():
    model, batch = small_model(), window()
    d = batch.x.M.shape[-1]
    eye = {"kernel": jnp.eye(d), "bias": jnp.zeros(d)}
    params = {"dense": eye, "gru_x": eye}

    def gates(**settings) -> np.ndarray:
        config = dataclasses.replace(MOTION, **settings)
        return np.asarray(noisy_gates(params, fast_key(0), batch.x.M, model.template, config))

    plain, hidden, noisy = gates(), gates(dropout=0.4), gates(motion_noise=0.1)
    gone = (hidden == 0).all(axis=0)
    assert 0.2 < gone.mean() < 0.6
    np.testing.assert_array_equal(hidden[:, ~gone], plain[:, ~gone])
    assert (gone[0] != gone[1]).any()
    assert 0.05 < np.abs(noisy - plain).mean() < 0.15


def test_in_canonical_pose_the_error_is_that_of_the_posed_garment():
    model = small_model()
    weights = garment_weights(model.scene, reach=0.1, mirrored=False)
    tables, batch = model.template._replace(W=weights), window()
    step = make_motion_train_step(tables, frozen()[0], CONFIG, GENERATIVE, OPTIMISER)
    metrics = step(first_state(), batch)[1]
    square = []
    for lane in range(LANES):
        carry = MotionCarry(jnp.zeros(MOTION.gru), batch.V_start[lane])
        for t in range(W):
            x = jax.tree.map(lambda leaf, t=t, lane=lane: leaf[t, lane], batch.x)
            # a body that stands: `one_frame` then carries the last frame over as it is
            still = x._replace(turn=jnp.eye(3), shift=jnp.zeros(3))
            carry, _ = one_frame(motion_params(), frozen()[0], carry, still)
            V = skinning.skin(np.asarray(carry.V_prev, float), weights, np.asarray(x.R), np.asarray(x.t))
            square.append(1e4 * np.square(V - batch.V_star[t, lane]).sum(axis=-1).mean())
    assert float(metrics["rmse_cm"]) == pytest.approx(np.sqrt(np.mean(square)), rel=1e-4)
