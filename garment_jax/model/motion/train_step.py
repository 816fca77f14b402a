"""Truncated back-propagation through time over the model's own predictions (paper 3.3).

Several lanes side by side, each in the middle of its own clip. A window's carry crosses into the next
window with its gradient cut. From the first step of a lane on, the model is fed what it predicted.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax

from garment_jax.config import GenerativeConfig, MotionConfig
from garment_jax.dataset.template import Template
from garment_jax.model.generative.canonical import posed
from garment_jax.model.generative.network import decode
from garment_jax.model.motion.losses import motion_terms
from garment_jax.model.motion.network import MotionCarry, gates_of, last_frame, motion_code, normalise_motion
from garment_jax.structs import FrameInput, TrainState


class MotionBatch(NamedTuple):
    """One window of every lane; W frames, L lanes."""

    x: FrameInput  # leaves [W, L, ...]
    V_star: Any  # [W, L, n, 3] metres, root frame
    Z_star: Any  # [W, L, latent] code of the truth
    weight: Any  # [W, L] how much each frame's error counts
    fresh: Any  # [L] bool, the lane begins here
    V_start: Any  # [L, n, 3] V_prev of fresh lanes, of frame -1 (skinned: of frame 0)


def empty_carry(lanes: int, n: int, config: MotionConfig) -> MotionCarry:
    """Return the carry of lanes that have not begun."""
    return MotionCarry(jnp.zeros((lanes, config.gru)), jnp.zeros((lanes, n, 3)))


def begin_lanes(carry: MotionCarry, batch: MotionBatch) -> MotionCarry:
    """Return the carry with fresh lanes reset and every gradient cut."""
    fresh = batch.fresh
    h = jnp.where(fresh[:, None], 0.0, carry.h)
    V_prev = jnp.where(fresh[:, None, None], batch.V_start, carry.V_prev)
    return jax.lax.stop_gradient(MotionCarry(h, V_prev))


def noisy_gates(
    params: dict, key: jax.Array, M: jax.Array, template: Template, config: MotionConfig
) -> jax.Array:
    """Return the GRU's input gates of a window with the configured noise; the key is consumed."""
    noise_key, drop_key = jax.random.split(key)
    x = normalise_motion(M, template)
    if config.motion_noise:
        x = x + config.motion_noise * jax.random.normal(noise_key, x.shape)
    if config.dropout:
        # whole features of a lane's window: a model that needs none of them alone generalises
        kept = jax.random.bernoulli(drop_key, 1 - config.dropout, x.shape[1:])
        x = x * kept[None]
    return gates_of(params, x)


def motion_loss(
    params: dict,
    frozen: dict,
    key: jax.Array,
    carry: MotionCarry,
    batch: MotionBatch,
    *,
    template: Template,
    config: MotionConfig,
    generative: GenerativeConfig,
) -> tuple[jax.Array, tuple[MotionCarry, dict[str, jax.Array]]]:
    """Return the weighted mean loss of a window, the carry after it and the terms; the key is consumed.

    `frozen` are the generative model's parameters: gradients pass through, nothing updates them.
    """
    gate_key, state_key = jax.random.split(key)
    gates = noisy_gates(params, gate_key, jnp.asarray(batch.x.M), template, config)

    def frame(carry: MotionCarry, inputs):
        x, gates, V_star, Z_star, key = inputs
        V_prev = last_frame(carry.V_prev, x, template)
        if config.state_noise:
            V_prev = V_prev + config.state_noise * jax.random.normal(key, V_prev.shape)
        h, Z = motion_code(
            params, carry.h, V_prev, gates, template=template, config=config, generative=generative
        )
        V = decode(frozen, Z, template=template, config=generative).V
        seen = posed(V, x, template=template)  # unposed, an error is larger where legs part
        terms = motion_terms(seen, V_star, Z, Z_star, template=template, config=config)
        return MotionCarry(h, V), (terms, 1e4 * jnp.square(seen - V_star).sum(axis=-1).mean(axis=-1))

    keys = jax.random.split(state_key, len(batch.V_star))
    inputs = (batch.x, gates, batch.V_star, batch.Z_star, keys)
    carry, (terms, square) = jax.lax.scan(frame, begin_lanes(carry, batch), inputs)
    total = batch.weight.sum()
    metrics = {name: (batch.weight * value).sum() / total for name, value in terms.items()}
    loss = sum(metrics.values(), jnp.zeros(()))
    rmse = jnp.sqrt((batch.weight * square).sum() / total)
    return loss, (carry, {**metrics, "loss": loss, "rmse_cm": rmse})


def make_motion_train_step(
    template: Template,
    frozen: dict,
    config: MotionConfig,
    generative: GenerativeConfig,
    optimiser: optax.GradientTransformation,
) -> Callable[[TrainState, MotionBatch], tuple[TrainState, dict[str, jax.Array]]]:
    """Return the jitted step (state, batch) -> (state, metrics); `state.carry` is a `MotionCarry`."""

    def step(state: TrainState, batch: MotionBatch, frozen: dict):
        key, used = jax.random.split(state.key)
        gradient, (carry, metrics) = jax.grad(motion_loss, has_aux=True)(
            state.params,
            frozen,
            used,
            state.carry,
            batch,
            template=template,
            config=config,
            generative=generative,
        )
        updates, opt_state = optimiser.update(gradient, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        metrics["gradient_norm"] = optax.tree.norm(gradient)
        return TrainState(params, opt_state, key, state.step + 1, carry), metrics

    compiled = jax.jit(step, donate_argnums=0)
    return lambda state, batch: compiled(state, batch, frozen)
