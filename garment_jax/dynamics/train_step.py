"""Truncated back-propagation through the local dynamics' own rollouts (not in the paper).

Lanes as in the motion stage. True starts get smooth noise, so that rollouts meet in training what they do
to themselves later; what a lane has predicted crosses into its next window with the gradient cut.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float

from garment_jax.config import DynamicsConfig
from garment_jax.dynamics.network import DynamicsCarry, dynamics_step
from garment_jax.dynamics.pose import BodyFrame
from garment_jax.dynamics.tables import DynamicsTables
from garment_jax.geometry.laplacian import laplacian
from garment_jax.geometry.uv_maps import from_map
from garment_jax.structs import TrainState

ERROR_FLOOR = 0.01  # cm2 under the root: no infinite gradient at zero error
CELLS = (4, 8)  # texels between independent values of the two scales of noise


class DynamicsBatch(NamedTuple):
    """One window of every lane; W frames, L lanes."""

    frame: BodyFrame  # leaves [W, L, ...]
    V_star: Any  # [W, L, n, 3] metres, root frame
    weight: Any  # [W, L] how much each frame's error counts
    fresh: Any  # [L] bool, the lane begins here
    V_start: Any  # [L, n, 3] of fresh lanes: the frame before the first, its own root frame
    V_before: Any  # [L, n, 3] the frame before that, in the same root frame
    noisy: Any  # [L] bool, the start is a true one and gets noise


def smooth_noise(key: jax.Array, lanes: int, tables: DynamicsTables) -> jax.Array:
    """Return displacements `[L, n, 3]` of deviation about 1, smooth over the cloth; the key is consumed."""
    h, w = tables.reach.shape
    field = jnp.zeros((lanes, h, w, 3))
    for k, cell in zip(jax.random.split(key, len(CELLS)), CELLS, strict=True):
        coarse = jax.random.normal(k, (lanes, -(-h // cell), -(-w // cell), 3))
        field += jax.image.resize(coarse, field.shape, "linear")
    return from_map(field, tables.atlas)


def begin_lanes(
    key: jax.Array,
    carry: DynamicsCarry,
    batch: DynamicsBatch,
    tables: DynamicsTables,
    config: DynamicsConfig,
) -> DynamicsCarry:
    """Return the carry with fresh lanes reset and every gradient cut; the key is consumed."""
    size_key, place_key, moved_key = jax.random.split(key, 3)
    lanes = len(batch.fresh)
    size = config.noise * jax.random.exponential(size_key, (lanes, 1, 1)) * batch.noisy[:, None, None]
    place = size * smooth_noise(place_key, lanes, tables)
    moved = 0.5 * size * smooth_noise(moved_key, lanes, tables)
    fresh = batch.fresh[:, None, None]
    V = jnp.where(fresh, batch.V_start + place, carry.V)
    V_before = jnp.where(fresh, batch.V_before + place + moved, carry.V_before)
    return jax.lax.stop_gradient(DynamicsCarry(V, V_before))


def dynamics_loss(
    params: dict,
    key: jax.Array,
    carry: DynamicsCarry,
    batch: DynamicsBatch,
    *,
    tables: DynamicsTables,
    config: DynamicsConfig,
) -> tuple[jax.Array, tuple[DynamicsCarry, dict[str, jax.Array]]]:
    """Return the mean over frames and lanes of the root mean squared errors, cm; the key is consumed.

    Of the vertices, and of their Laplacian times `lambda_laplacian`. A root for each lane and frame: a lane
    that has lost its folds does not drown the others.
    """

    def frame(carry: DynamicsCarry, inputs: tuple[BodyFrame, jax.Array]):
        body, V_star = inputs
        carry = dynamics_step(params, carry, body, tables=tables, config=config)
        E = carry.V - V_star
        return carry, (mean_square(E), mean_square(laplacian(E, tables.laplacian)))

    begun = begin_lanes(key, carry, batch, tables, config)
    carry, squares = jax.lax.scan(jax.checkpoint(frame), begun, (batch.frame, batch.V_star))
    total = batch.weight.sum()
    vertex, rough = ((batch.weight * jnp.sqrt(x + ERROR_FLOOR)).sum() / total for x in squares)
    rough = config.lambda_laplacian * rough
    rmse = jnp.sqrt((batch.weight * squares[0]).sum() / total)
    metrics = {"loss": vertex + rough, "vertex": vertex, "laplacian": rough, "rmse_cm": rmse}
    return vertex + rough, (carry, metrics)


def mean_square(E: Float[Array, "*b n 3"]) -> Float[Array, "*b"]:
    """Return the mean squared length over vertices, cm^2, of `E` in metres."""
    return 1e4 * jnp.square(E).sum(axis=-1).mean(axis=-1)


def make_dynamics_train_step(
    tables: DynamicsTables, config: DynamicsConfig, optimiser: optax.GradientTransformation
) -> Callable[[TrainState, DynamicsBatch], tuple[TrainState, dict[str, jax.Array]]]:
    """Return the jitted step (state, batch) -> (state, metrics); `state.carry` is a `DynamicsCarry`."""

    def step(state: TrainState, batch: DynamicsBatch):
        key, used = jax.random.split(state.key)
        gradient, (carry, metrics) = jax.grad(dynamics_loss, has_aux=True)(
            state.params, used, state.carry, batch, tables=tables, config=config
        )
        updates, opt_state = optimiser.update(gradient, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        metrics["gradient_norm"] = optax.tree.norm(gradient)
        return TrainState(params, opt_state, key, state.step + 1, carry), metrics

    return jax.jit(step, donate_argnums=0)
