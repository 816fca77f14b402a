"""The recurrent regressor: its scan against a NumPy loop, its windows against one long sequence."""

import jax
import jax.numpy as jnp
import numpy as np
import optax

from garment_jax.baselines.recurrent import (
    WindowBatch,
    first_hidden,
    init_recurrent,
    lane_slices,
    make_window_step,
    recur,
    window_loss,
)
from garment_jax.dataset.lanes import LaneWindow
from garment_jax.structs import TrainState

PARAMS = jax.jit(lambda key: init_recurrent(key, inputs=3, width=4, outputs=2))(jax.random.key(0))
X = np.random.default_rng(0).normal(size=(7, 3)).astype(np.float32)


def sigmoid(x: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-x))


def slow(x: np.ndarray) -> np.ndarray:
    """The equations of PyTorch's GRUCell and a dense layer, written out."""
    p = jax.tree.map(lambda a: np.asarray(a, np.float64), PARAMS)
    h, out = np.zeros(4), []
    for row in x:
        gx = row @ p["gru_x"]["kernel"] + p["gru_x"]["bias"]
        gh = h @ p["gru_h"]["kernel"] + p["gru_h"]["bias"]
        reset, update = sigmoid(gx[:4] + gh[:4]), sigmoid(gx[4:8] + gh[4:8])
        h = (1 - update) * np.tanh(gx[8:] + reset * gh[8:]) + update * h
        out.append(h @ p["out"]["kernel"] + p["out"]["bias"])
    return np.stack(out)


def square(out: jax.Array, target: jax.Array) -> jax.Array:
    return jnp.square(out - target).sum(axis=-1)


def test_a_scan_is_the_loop_alone_and_side_by_side() -> None:
    h = first_hidden(PARAMS)
    np.testing.assert_allclose(jax.jit(recur)(PARAMS, h, X)[1], slow(X), atol=1e-5)
    both = jax.jit(recur)(PARAMS, np.stack([h, h]), np.stack([X[::-1], X], axis=1))[1]
    np.testing.assert_allclose(both[:, 1], slow(X), atol=1e-5)


def batch(start: int, *, fresh: bool) -> WindowBatch:
    target = np.zeros((3, 1, 2), np.float32)
    weight = np.array([1.0, 3.0, 0.0], np.float32)[:, None]
    return WindowBatch(X[start : start + 3, None], target, weight, np.array([fresh]))


def test_a_window_goes_on_where_the_last_ended_unless_it_is_fresh() -> None:
    error = jax.tree_util.Partial(square)
    loss = jax.jit(lambda h, b: window_loss(PARAMS, h, b, error=error))
    h = jnp.ones((1, 4))
    first, (h, _) = loss(h, batch(0, fresh=True))
    second, _ = loss(h, batch(3, fresh=False))
    rows = np.square(slow(X)).sum(axis=-1)
    np.testing.assert_allclose(first, (rows[0] + 3 * rows[1]) / 4, rtol=1e-4)
    np.testing.assert_allclose(second, (rows[3] + 3 * rows[4]) / 4, rtol=1e-4)


def test_steps_lower_the_loss_of_one_batch() -> None:
    optimiser = optax.adam(0.02)
    step = make_window_step(square, optimiser)
    one = batch(0, fresh=True)._replace(target=np.ones((3, 1, 2), np.float32))
    params = jax.tree.map(jnp.array, PARAMS)
    state = TrainState(params, optimiser.init(params), jax.random.key(1), jnp.int32(0), jnp.zeros((1, 4)))
    losses = []
    for _ in range(60):
        state, metrics = step(state, one)
        losses.append(float(metrics["loss"]))
    assert losses[-1] < 0.05 * losses[0]


def test_slices_are_each_lanes_own_frames() -> None:
    clips = [np.arange(10) + 100 * k for k in range(3)]
    none = np.zeros(2, bool)
    lanes = LaneWindow(np.array([2, 0]), np.array([4, 1]), none, none, np.zeros(2, int))
    np.testing.assert_array_equal(lane_slices(clips, lanes, 3), [[204, 1], [205, 2], [206, 3]])
