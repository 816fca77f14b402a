"""The training window of the local dynamics: lanes, noise, loss, and that it learns."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.config import TrainingConfig
from garment_jax.dynamics.network import DynamicsCarry, dynamics_step
from garment_jax.dynamics.pose import BodyFrame
from garment_jax.dynamics.train_step import (
    DynamicsBatch,
    begin_lanes,
    dynamics_loss,
    make_dynamics_train_step,
    smooth_noise,
)
from garment_jax.structs import TrainState
from garment_jax.training.optimiser import make_optimiser
from tests.reference.laplacian import uniform_laplacian
from tests.reference.tiny_dynamics import DYNAMICS, frames, hanging, params, tables
from tests.rollout.tiny_model import SCENE

W, L = 4, 2


def batch(noisy: bool = False) -> DynamicsBatch:
    body = frames(W + 3)
    windows = BodyFrame(*(np.stack([leaf[:W], leaf[3 : 3 + W]], axis=1) for leaf in body))
    T = hanging().V
    truth = np.broadcast_to(T, (W, L, *T.shape[1:])) * np.float32(1.02)
    start = np.repeat(T, L, axis=0)
    weight = np.array([[1.0, 0.5]] * W, np.float32)
    return DynamicsBatch(windows, truth, weight, np.array([True, False]), start, start, np.full(L, noisy))


def carry() -> DynamicsCarry:
    V = jnp.asarray(np.repeat(hanging().V, L, axis=0))
    return DynamicsCarry(1.01 * V, 1.005 * V)


def test_fresh_lanes_begin_anew_and_the_others_go_on():
    begun = begin_lanes(jax.random.key(0), carry(), batch(), tables(), DYNAMICS)
    np.testing.assert_array_equal(begun.V[0], hanging().V[0])
    np.testing.assert_array_equal(begun.V[1], carry().V[1])
    np.testing.assert_array_equal(begun.V_before[1], carry().V_before[1])


def test_noise_comes_to_true_starts_alone_and_is_smooth():
    begun = begin_lanes(jax.random.key(0), carry(), batch(noisy=True), tables(), DYNAMICS)
    off = np.asarray(begun.V[0] - hanging().V[0])
    assert 1e-5 < np.abs(off).max() < 0.1
    np.testing.assert_array_equal(begun.V[1], carry().V[1])
    noise = np.asarray(smooth_noise(jax.random.key(1), 40, tables())).reshape(40, 8, 16, 3)
    assert 0.5 < noise.std() < 2.0
    neighbours = (noise[:, :, 1:] - noise[:, :, :-1]).std()
    assert neighbours < 0.7 * noise.std()


def test_the_loss_is_the_weighted_mean_of_a_loops_errors():
    b, total = batch(), 0.0
    state = begin_lanes(jax.random.key(2), carry(), b, tables(), DYNAMICS)
    for t in range(W):
        frame = BodyFrame(*(jnp.asarray(leaf[t]) for leaf in b.frame))
        state = dynamics_step(params(), state, frame, tables=tables(), config=DYNAMICS)
        E = np.asarray(state.V) - b.V_star[t]
        rough = np.stack([uniform_laplacian(e, SCENE.garment.faces) for e in E])
        for part, wanted in ((1.0, E), (DYNAMICS.lambda_laplacian, rough)):
            square = 1e4 * np.square(wanted).sum(axis=-1).mean(axis=-1)
            total += (part * b.weight[t] * np.sqrt(square + 0.01)).sum()
    loss, (after, metrics) = dynamics_loss(
        params(), jax.random.key(2), carry(), b, tables=tables(), config=DYNAMICS
    )
    assert float(loss) == pytest.approx(total / b.weight.sum(), rel=1e-5)
    assert float(metrics["loss"]) == float(loss)
    np.testing.assert_allclose(after.V, state.V, atol=1e-5)


def test_it_overfits_one_batch():
    optimiser = make_optimiser(
        TrainingConfig(schedule="constant", warmup=0.0), learning_rate=3e-3, weight_decay=0.0, steps=150
    )
    step = make_dynamics_train_step(tables(), DYNAMICS, optimiser)
    start = jax.tree.map(jnp.array, params())
    b = batch()._replace(fresh=np.array([True, True]))
    state = TrainState(start, optimiser.init(start), jax.random.key(3), jnp.int32(0), carry())
    losses = []
    for _ in range(150):
        state, metrics = step(state, b)
        losses.append(float(metrics["rmse_cm"]))
    assert losses[-1] < 0.4 * losses[0]
    assert int(state.step) == 150
