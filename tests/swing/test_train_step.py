"""The ring's training window: lanes, noise, loss, and that it learns."""

import dataclasses
from itertools import pairwise
from operator import itemgetter

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.config import TrainingConfig
from garment_jax.structs import TrainState
from garment_jax.swing.network import SwingCarry, seen_gates, swing_step
from garment_jax.swing.train_step import SwingBatch, begin_lanes, make_swing_train_step, swing_loss
from garment_jax.training.optimiser import make_optimiser
from tests.reference.tiny_swing import SWING, frames, params, tables

W, L = 4, 2


def batch(noisy: bool = False) -> SwingBatch:
    windows = jax.tree.map(lambda leaf: jnp.stack([leaf[:W], leaf[3 : 3 + W]], axis=1), frames(W + 3))
    rest = np.broadcast_to(tables().rest, (L, *tables().rest.shape))
    truth = np.broadcast_to(1.02 * rest, (W, *rest.shape))
    return SwingBatch(windows, truth, np.array([True, False]), rest, np.full(L, noisy))


def carry() -> SwingCarry:
    X = jnp.broadcast_to(1.01 * tables().rest, (L, *tables().rest.shape))
    return SwingCarry(X, 0.01 + 0 * X, jnp.full((L, SWING.columns, SWING.hidden), 0.3))


def test_fresh_lanes_begin_anew_and_the_others_go_on():
    begun = begin_lanes(jax.random.key(0), carry(), batch(), SWING)
    np.testing.assert_array_equal(begun.X[0], tables().rest)
    assert not np.any(begun.moved[0])
    assert not np.any(begun.h[0])
    for after, before in zip(begun, carry(), strict=True):
        np.testing.assert_array_equal(after[1], before[1])


def test_noise_moves_a_true_starts_columns_as_wholes():
    begun = begin_lanes(jax.random.key(0), carry(), batch(noisy=True), SWING)
    off = np.asarray(begun.X[0] - tables().rest)
    assert 0.3 * SWING.noise < off.std() < 3 * SWING.noise
    np.testing.assert_allclose(off, off[:, :1] + 0 * off, atol=1e-6)
    np.testing.assert_array_equal(begun.X[1], carry().X[1])


def test_the_loss_is_the_mean_of_a_loops_errors():
    b = batch()
    state = begin_lanes(jax.random.key(2), carry(), b, SWING)
    errors = []
    for t in range(W):
        frame = jax.tree.map(lambda leaf, t=t: jnp.asarray(leaf[t]), b.frame)
        gates = seen_gates(params(), frame.seen, config=SWING)
        state = swing_step(params(), state, frame, gates, tables=tables(), config=SWING)
        errors.append(np.asarray(state.X) - b.X_star[t])

    def rooted(E: np.ndarray) -> float:
        return float(np.mean([np.sqrt(sum((tables().share * (e**2).sum(-1)).ravel())) for e in E])) * 100

    place = np.mean([rooted(E) for E in errors])
    movement = np.mean([rooted(b - a) for a, b in pairwise(errors)])
    loss, (after, metrics) = swing_loss(
        params(), jax.random.key(2), carry(), jax.tree.map(jnp.asarray, b), tables=tables(), config=SWING
    )
    assert float(loss) == pytest.approx(place + movement, rel=1e-3)
    assert float(metrics["rmse_cm"]) == pytest.approx(place, rel=1e-3)
    np.testing.assert_allclose(after.X, state.X, atol=1e-5)


def test_it_overfits_one_batch():
    optimiser = make_optimiser(
        TrainingConfig(schedule="constant", warmup=0.0), learning_rate=1e-2, weight_decay=0.0, steps=200
    )
    step = make_swing_train_step(tables(), SWING, optimiser)
    start = jax.tree.map(jnp.array, params())
    b = batch()._replace(fresh=np.array([True, True]))
    state = TrainState(start, optimiser.init(start), jax.random.key(3), jnp.int32(0), carry())
    losses = []
    for _ in range(200):
        state, metrics = step(state, b)
        losses.append(float(metrics["rmse_cm"]))
    assert losses[-1] < 0.3 * losses[0]
    assert int(state.step) == 200


def test_dropout_and_noise_differ_from_window_to_window():
    def loss(key: int, dropout: float, noise: float = 0.0) -> float:
        config = dataclasses.replace(SWING, dropout=dropout, motion_noise=noise)
        b = jax.tree.map(jnp.asarray, batch())
        return float(swing_loss(params(), jax.random.key(key), carry(), b, tables=tables(), config=config)[0])

    assert loss(0, 0.0) == loss(1, 0.0)
    assert loss(0, 0.5) != loss(1, 0.5)
    assert np.isfinite(loss(0, 1.0))
    assert loss(0, 0.0, 0.1) != loss(1, 0.0, 0.1)
    assert loss(0, 0.0, 1e-5) == pytest.approx(loss(0, 0.0), rel=1e-3)


def test_what_is_hidden_from_a_lane_is_as_if_it_were_not_there():
    """Channels that are kept count 1 / (1 - dropout), the others nothing, in every column and frame."""
    kept = jnp.asarray(np.array([0.0, 2.0] * (SWING.width // 2), np.float32))
    frame = jax.tree.map(lambda leaf: jnp.asarray(leaf[0, 0]), batch().frame)
    start = jax.tree.map(itemgetter(0), carry())
    config = dataclasses.replace(SWING, layers=0)
    gates = seen_gates(params(), frame.seen, config=config)
    masked = swing_step(params(), start, frame, gates, tables=tables(), config=config, kept=kept[None])
    cut = dict(params())  # what reads the first layer: its mean, its largest, its own gates
    double = jnp.concatenate([kept, kept])[:, None]
    cut["all"] = params()["all"] | {"kernel": params()["all"]["kernel"] * double}
    cut["gates"] = params()["gates"] | {"kernel": params()["gates"]["kernel"] * kept[:, None]}
    by_weights = swing_step(cut, start, frame, gates, tables=tables(), config=config)
    np.testing.assert_allclose(masked.h, by_weights.h, atol=1e-5)
