"""A warm-up of the motion encoder in the linearised latent space (a schedule of ours, not the paper's).

A decoded garment is nearly linear in Z, and E_s' pooled path sees nothing but the pooled map. So the loop
Z -> garment -> map -> E_s can be run with small matrices, fifty times as fast as through the
decoders: V = mean + Z modes, its pooled map likewise, and the carry-over into the next root frame acts on
pooled positions as it does on vertices. What is learnt are E_m, fc and E_s' pooled path themselves;
the full loop goes on from there.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from garment_jax.config import MotionConfig
from garment_jax.dataset.template import Template
from garment_jax.geometry.laplacian import laplacian
from garment_jax.geometry.uv_maps import to_map
from garment_jax.model.generative.blocks import PooledSkip, along_channels, pool
from garment_jax.model.generative.network import POOLED
from garment_jax.model.motion.network import gru_step, last_frame
from garment_jax.model.motion.train_step import noisy_gates
from garment_jax.structs import FrameInput, TrainState


class LinearGarment(NamedTuple):
    """The garment as a linear function of Z, as far as E_s' pooled path and the loss need it."""

    pooled_mean: np.ndarray  # [p, 3] metres, networks' frame
    pooled_modes: np.ndarray  # [K, p, 3] metres per unit of Z
    metric: np.ndarray  # [K, K]; |dZ @ metric|^2 is L_geo in cm2


class WarmUpBatch(NamedTuple):
    """One window of every lane; W frames, L lanes."""

    x: FrameInput  # leaves [W, L, ...]
    Z_star: Any  # [W, L, K]
    weight: Any  # [W, L]
    fresh: Any  # [L] bool
    pooled_start: Any  # [L, p, 3] metres, pooled map of the lane's first V_prev


class WarmUpCarry(NamedTuple):
    """State of the lanes between windows."""

    h: jax.Array  # [L, gru]
    pooled: jax.Array  # [L, p, 3] metres


def pooled_map(V: jax.Array, template: Template) -> jax.Array:
    """Return the pooled UV position map of `V` `[*b, n, 3]`, `[*b, p, 3]` metres, not normalised."""
    size = min(POOLED, template.atlas.coverage.shape[0])
    pooled = pool(to_map(V, template.atlas), size)
    return pooled.reshape(*V.shape[:-2], -1, 3)


def fit_linear_garment(
    Z: np.ndarray, V: np.ndarray, *, template: Template, lambda_laplacian: float
) -> LinearGarment:
    """Return the least-squares linear garment of latents `Z` `[F, K]` and vertices `V` `[F, n, 3]`."""
    n = V.shape[1]
    design = np.concatenate([Z, np.ones((len(Z), 1), Z.dtype)], axis=1).astype(np.float64)
    gram = design.T @ design + 1e-6 * len(Z) * np.eye(design.shape[1])
    solution = np.linalg.solve(gram, design.T @ V.reshape(len(V), -1)).astype(np.float32)
    fields = solution.reshape(-1, n, 3)
    pooled = np.asarray(jax.jit(lambda v: pooled_map(v, template))(fields))
    rough = np.asarray(jax.jit(lambda v: laplacian(v, template.laplacian))(fields[:-1]))
    modes = fields[:-1].reshape(len(fields) - 1, -1).astype(np.float64)
    rough = rough.reshape(len(modes), -1).astype(np.float64)
    quadratic = (modes @ modes.T + lambda_laplacian * rough @ rough.T) * 1e4 / n
    metric = np.linalg.cholesky(quadratic + 1e-9 * np.trace(quadratic) * np.eye(len(quadratic)))
    return LinearGarment(pooled[-1], pooled[:-1], metric.astype(np.float32))


def empty_warm_up_carry(lanes: int, linear: LinearGarment, config: MotionConfig) -> WarmUpCarry:
    """Return the carry of lanes that have not begun."""
    return WarmUpCarry(jnp.zeros((lanes, config.gru)), jnp.zeros((lanes, *linear.pooled_mean.shape)))


def _code(
    params: dict, h: jax.Array, pooled: jax.Array, template: Template, config: MotionConfig
) -> jax.Array:
    """Return Z from the GRU state and the pooled map: `motion_code` without E_s' convolutions."""
    joined = h
    if config.previous_state:
        known = template.statistics
        mean, std = (jnp.broadcast_to(x, pooled.shape) for x in (known.map_mean, known.map_std))
        normal = ((pooled - mean) / std).reshape(*pooled.shape[:-2], -1)
        skip = PooledSkip(config.state_dim, config.state_hidden)
        e = jnp.asarray(skip.apply({"params": params["E_s"]["skip"]}, normal))
        joined = jnp.concatenate([h, e + along_channels(params["E_s"]["Dense_0"]["bias"], e)], axis=-1)
    return joined @ params["fc"]["kernel"] + along_channels(params["fc"]["bias"], joined)


def warm_up_loss(
    params: dict,
    key: jax.Array,
    carry: WarmUpCarry,
    batch: WarmUpBatch,
    *,
    linear: LinearGarment,
    template: Template,
    config: MotionConfig,
) -> tuple[jax.Array, tuple[WarmUpCarry, dict[str, jax.Array]]]:
    """Return the weighted mean loss of a window, the carry after it and the terms; the key is consumed."""
    gate_key, state_key = jax.random.split(key)
    gates = noisy_gates(params, gate_key, jnp.asarray(batch.x.M), template, config)
    fresh = batch.fresh
    begun = WarmUpCarry(
        jnp.where(fresh[:, None], 0.0, carry.h),
        jnp.where(fresh[:, None, None], batch.pooled_start, carry.pooled),
    )
    modes = linear.pooled_modes.reshape(len(linear.pooled_modes), -1)

    def frame(carry: WarmUpCarry, inputs):
        x, gates, key = inputs
        pooled = last_frame(carry.pooled, x, template)
        if config.state_noise:
            # smooth over the garment: a random code, of the stated size in vertices
            pooled = pooled + config.state_noise * jax.random.normal(key, (len(pooled), 1, 3))
        h = gru_step(params, carry.h, gates)
        Z = _code(params, h, pooled, template, config)
        pooled = jnp.broadcast_to(linear.pooled_mean, pooled.shape) + (Z @ modes).reshape(pooled.shape)
        return WarmUpCarry(h, pooled), Z

    keys = jax.random.split(state_key, len(gates))
    carry, Z = jax.lax.scan(frame, jax.lax.stop_gradient(begun), (batch.x, gates, keys))
    geometry = jnp.square((Z - batch.Z_star) @ linear.metric).sum(axis=-1)
    latent = config.lambda_latent * jnp.square(Z - batch.Z_star).mean(axis=-1)
    total = batch.weight.sum()
    metrics = {
        "geometry": (batch.weight * geometry).sum() / total,
        "latent": (batch.weight * latent).sum() / total,
    }
    loss = sum(metrics.values(), jnp.zeros(()))
    return loss, (carry, {**metrics, "loss": loss, "rmse_cm": jnp.sqrt(metrics["geometry"])})


def make_warm_up_step(
    linear: LinearGarment,
    template: Template,
    config: MotionConfig,
    optimiser: optax.GradientTransformation,
) -> Callable[[TrainState, WarmUpBatch], tuple[TrainState, dict[str, jax.Array]]]:
    """Return the jitted step (state, batch) -> (state, metrics); `state.carry` is a `WarmUpCarry`."""

    def step(state: TrainState, batch: WarmUpBatch):
        key, used = jax.random.split(state.key)
        gradient, (carry, metrics) = jax.grad(warm_up_loss, has_aux=True)(
            state.params, used, state.carry, batch, linear=linear, template=template, config=config
        )
        updates, opt_state = optimiser.update(gradient, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        metrics["gradient_norm"] = optax.tree.norm(gradient)
        return TrainState(params, opt_state, key, state.step + 1, carry), metrics

    return jax.jit(step, donate_argnums=0)
