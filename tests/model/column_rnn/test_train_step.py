"""The ring's training window: lanes, noise, loss, and that it learns."""

import dataclasses
from itertools import pairwise
from operator import itemgetter

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.config import TrainingConfig
from garment_jax.model.column_rnn import train_step
from garment_jax.model.column_rnn.network import column_step, roll_columns, seen_gates
from garment_jax.model.column_rnn.train_step import (
    ColumnBatch,
    begin_lanes,
    column_loss,
    make_column_train_step,
)
from garment_jax.structs import ColumnCarry, TrainState
from garment_jax.training.optimiser import make_optimiser
from tests.reference.tiny_column_rnn import COLUMNS, frames, params, tables

W, L = 4, 2


def batch(noisy: bool = False) -> ColumnBatch:
    windows = jax.tree.map(lambda leaf: jnp.stack([leaf[:W], leaf[3 : 3 + W]], axis=1), frames(W + 3))
    rest = np.broadcast_to(tables().rest, (L, *tables().rest.shape))
    truth = np.broadcast_to(1.02 * rest, (W, *rest.shape))
    return ColumnBatch(windows, truth, np.array([True, False]), rest, np.full(L, noisy))


def carry() -> ColumnCarry:
    X = jnp.broadcast_to(1.01 * tables().rest, (L, *tables().rest.shape))
    return ColumnCarry(X, 0.01 + 0 * X, jnp.full((L, COLUMNS.columns, COLUMNS.hidden), 0.3))


def test_fresh_lanes_begin_anew_and_the_others_go_on():
    begun = begin_lanes(jax.random.key(0), carry(), batch(), COLUMNS)
    np.testing.assert_array_equal(begun.X[0], tables().rest)
    assert not np.any(begun.moved[0])
    assert not np.any(begun.h[0])
    for after, before in zip(begun, carry(), strict=True):
        np.testing.assert_array_equal(after[1], before[1])


def test_noise_moves_a_true_starts_columns_as_wholes():
    begun = begin_lanes(jax.random.key(0), carry(), batch(noisy=True), COLUMNS)
    off = np.asarray(begun.X[0] - tables().rest)
    assert 0.3 * COLUMNS.noise < off.std() < 3 * COLUMNS.noise
    np.testing.assert_allclose(off, off[:, :1] + 0 * off, atol=1e-6)
    np.testing.assert_array_equal(begun.X[1], carry().X[1])


def test_the_loss_is_the_mean_of_a_loops_errors():
    b = batch()
    state = begin_lanes(jax.random.key(2), carry(), b, COLUMNS)
    errors = []
    for t in range(W):
        frame = jax.tree.map(lambda leaf, t=t: jnp.asarray(leaf[t]), b.frame)
        gates = seen_gates(params(), frame.seen, config=COLUMNS)
        state = column_step(params(), state, frame, gates, tables=tables(), config=COLUMNS)
        errors.append(np.asarray(state.X) - b.X_star[t])

    def rooted(E: np.ndarray) -> float:
        return float(np.mean([np.sqrt(sum((tables().share * (e**2).sum(-1)).ravel())) for e in E])) * 100

    place = np.mean([rooted(E) for E in errors])
    movement = np.mean([rooted(b - a) for a, b in pairwise(errors)])
    loss, (after, metrics) = column_loss(
        params(), jax.random.key(2), carry(), jax.tree.map(jnp.asarray, b), tables=tables(), config=COLUMNS
    )
    assert float(loss) == pytest.approx(place + movement, rel=1e-3)
    assert float(metrics["rmse_cm"]) == pytest.approx(place, rel=1e-3)
    np.testing.assert_allclose(after.X, state.X, atol=1e-5)


def test_it_overfits_one_batch():
    optimiser = make_optimiser(
        TrainingConfig(schedule="constant", warmup=0.0), learning_rate=1e-2, weight_decay=0.0, steps=200
    )
    step = make_column_train_step(tables(), COLUMNS, optimiser)
    start = jax.tree.map(jnp.array, params())
    b = batch()._replace(fresh=np.array([True, True]))
    state = TrainState(start, optimiser.init(start), jax.random.key(3), jnp.int32(0), carry())
    losses = []
    for _ in range(200):
        state, metrics = step(state, b)
        losses.append(float(metrics["rmse_cm"]))
    assert losses[-1] < 0.3 * losses[0]
    assert int(state.step) == 200


def seen_by_the_ring(monkeypatch: pytest.MonkeyPatch, key: int, **changes: float) -> tuple:
    """Return the start, the frames and what is kept of the first layer, as `column_loss` rolls them out."""
    caught: list = []

    def caught_and_rolled(p, start, frame, *, tables, config, kept):
        caught.append((start, frame, kept))
        return roll_columns(p, start, frame, tables=tables, config=config, kept=kept)

    monkeypatch.setattr(train_step, "roll_columns", caught_and_rolled)
    config = dataclasses.replace(COLUMNS, **changes)
    b = jax.tree.map(jnp.asarray, batch(noisy=True))
    loss, _ = column_loss(params(), jax.random.key(key), carry(), b, tables=tables(), config=config)
    assert np.isfinite(loss)
    return caught[0]


def test_a_window_without_dropout_and_noise_is_as_ever(monkeypatch: pytest.MonkeyPatch):
    start, frame, kept = seen_by_the_ring(monkeypatch, 5)
    for mine, known in zip(
        start, begin_lanes(jax.random.key(5), carry(), batch(noisy=True), COLUMNS), strict=True
    ):
        np.testing.assert_array_equal(mine, known)
    np.testing.assert_array_equal(frame.seen, batch().frame.seen)
    assert kept is None


def test_dropout_hides_channels_of_a_lane_in_every_column_and_frame(monkeypatch: pytest.MonkeyPatch):
    kept = np.asarray(seen_by_the_ring(monkeypatch, 0, dropout=0.5)[2])
    assert kept.shape == (L, 1, COLUMNS.width)  # of all columns, and of all frames: there is no axis for them
    assert set(np.unique(kept)) == {0.0, 2.0}
    assert not np.array_equal(kept[0], kept[1])
    assert not np.array_equal(kept, seen_by_the_ring(monkeypatch, 1, dropout=0.5)[2])
    assert not np.asarray(seen_by_the_ring(monkeypatch, 0, dropout=1.0)[2]).any()


def test_noise_on_the_motion_is_one_draw_for_a_window(monkeypatch: pytest.MonkeyPatch):
    frame = seen_by_the_ring(monkeypatch, 0, motion_noise=0.1)[1]
    noise = np.asarray(frame.seen - batch().frame.seen)
    np.testing.assert_allclose(noise, noise[:1] + 0 * noise, atol=1e-5)
    assert noise[0].std() == pytest.approx(0.1, rel=0.1)
    assert abs(np.corrcoef(noise[0, 0].ravel(), noise[0, 1].ravel())[0, 1]) < 0.3
    for name in ("way", "turn", "anchor"):
        np.testing.assert_array_equal(getattr(frame, name), getattr(batch().frame, name))


def test_what_is_hidden_from_a_lane_is_as_if_it_were_not_there():
    """What reads the first layer sees the channels kept as often as `kept` says, in every column."""
    kept = jnp.asarray(np.array([0.0, 2.0] * (COLUMNS.width // 2), np.float32))
    frame = jax.tree.map(lambda leaf: jnp.asarray(leaf[0, 0]), batch().frame)
    start = jax.tree.map(itemgetter(0), carry())
    config = dataclasses.replace(COLUMNS, layers=0)
    gates = seen_gates(params(), frame.seen, config=config)
    masked = column_step(params(), start, frame, gates, tables=tables(), config=config, kept=kept[None])
    cut = dict(params())  # what reads the first layer: its mean, its largest, its own gates
    double = jnp.concatenate([kept, kept])[:, None]
    cut["all"] = params()["all"] | {"kernel": params()["all"]["kernel"] * double}
    cut["gates"] = params()["gates"] | {"kernel": params()["gates"]["kernel"] * kept[:, None]}
    by_weights = column_step(cut, start, frame, gates, tables=tables(), config=config)
    np.testing.assert_allclose(masked.h, by_weights.h, atol=1e-5)
