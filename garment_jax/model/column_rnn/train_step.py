"""Truncated back-propagation through the ring's own rollouts (not in the paper)."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax

from garment_jax.config import ColumnRnnConfig
from garment_jax.dataset.template import ColumnTables
from garment_jax.model.column_rnn.network import roll_columns
from garment_jax.structs import ColumnCarry, ColumnFrame, TrainState

ERROR_FLOOR = 1e-8  # m2 under the root: no infinite gradient at zero error


class ColumnBatch(NamedTuple):
    """One window of every lane; W frames, L lanes."""

    frame: ColumnFrame  # leaves [W, L, ...]
    X_star: Any  # [W, L, a, h, 3] metres from the anchors, columns' frames
    fresh: Any  # [L] bool, the lane begins here
    X_start: Any  # [L, a, h, 3] of fresh lanes: the frame before the first
    noisy: Any  # [L] bool, the start is a true one and gets noise


def begin_lanes(
    key: jax.Array, carry: ColumnCarry, batch: ColumnBatch, config: ColumnRnnConfig
) -> ColumnCarry:
    """Return the carry with fresh lanes reset and every gradient cut; the key is consumed.

    A true start gets noise, one draw for each column, so that the network learns to correct its state.
    """
    lanes, a = batch.X_start.shape[:2]
    noise = config.noise * jax.random.normal(key, (lanes, a, 1, 3)) * batch.noisy[:, None, None, None]
    fresh = batch.fresh[:, None, None, None]
    X = jnp.where(fresh, batch.X_start + noise, carry.X)
    moved = jnp.where(fresh, 0.0, carry.moved)
    h = jnp.where(batch.fresh[:, None, None], 0.0, carry.h)
    return jax.lax.stop_gradient(ColumnCarry(X, moved, h))


def column_loss(
    params: dict,
    key: jax.Array,
    carry: ColumnCarry,
    batch: ColumnBatch,
    *,
    tables: ColumnTables,
    config: ColumnRnnConfig,
) -> tuple[jax.Array, tuple[ColumnCarry, dict[str, jax.Array]]]:
    """Return the mean over frames and lanes of the root mean squared errors, cm; the key is consumed.

    Of the cells' places and of their movements, a cell counting by the vertices that it holds. A root for
    each lane and frame: a lane that has lost its folds does not drown the others.
    """
    plain = not (config.dropout or config.motion_noise)  # then as ever, number for number
    start_key, drop_key, noise_key = (key, key, key) if plain else jax.random.split(key, 3)
    begun, kept, frame = begin_lanes(start_key, carry, batch, config), None, batch.frame
    if config.dropout:
        stays = 1.0 - config.dropout
        kept = jax.random.bernoulli(drop_key, stays, (len(batch.fresh), 1, config.width)) / max(stays, 1e-3)
    if config.motion_noise:  # one draw for all frames: noise that changed would look like movement
        noise = config.motion_noise * jax.random.normal(noise_key, frame.seen.shape[1:])
        frame = frame._replace(seen=frame.seen + jnp.broadcast_to(noise, frame.seen.shape))
    carry, X = roll_columns(params, begun, frame, tables=tables, config=config, kept=kept)
    E = X - batch.X_star

    def rooted(E: jax.Array) -> jax.Array:
        square = jnp.einsum("...ahi,ah->...", jnp.square(E), tables.share)
        return 100.0 * jnp.sqrt(square + ERROR_FLOOR).mean()

    place, movement = rooted(E), rooted(E[1:] - E[:-1])
    return place + movement, (carry, {"loss": place + movement, "rmse_cm": place, "movement": movement})


def make_column_train_step(
    tables: ColumnTables, config: ColumnRnnConfig, optimiser: optax.GradientTransformation
) -> Callable[[TrainState, ColumnBatch], tuple[TrainState, dict[str, jax.Array]]]:
    """Return the jitted step (state, batch) -> (state, metrics); `state.carry` is a `ColumnCarry`."""

    def step(state: TrainState, batch: ColumnBatch):
        key, used = jax.random.split(state.key)
        gradient, (carry, metrics) = jax.grad(column_loss, has_aux=True)(
            state.params, used, state.carry, batch, tables=tables, config=config
        )
        updates, opt_state = optimiser.update(gradient, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        metrics["gradient_norm"] = optax.tree.norm(gradient)
        return TrainState(params, opt_state, key, state.step + 1, carry), metrics

    return jax.jit(step, donate_argnums=0)
