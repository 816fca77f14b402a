"""The train step of the garment generative model (paper 3.2)."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax

from garment_jax.config import GenerativeConfig
from garment_jax.dataset.template import Template
from garment_jax.model.generative.losses import LIVE_NATS, generative_terms, kl_per_dimension
from garment_jax.model.generative.network import decode, encode
from garment_jax.structs import TrainState


class GenerativeBatch(NamedTuple):
    """Frames to reconstruct."""

    V_star: Any  # [B, n, 3] metres, networks' frame
    T_tilde_star: Any  # [B, n, 3] metres, canonical; by inverse skinning


def generative_loss(
    params: dict,
    key: jax.Array,
    batch: GenerativeBatch,
    *,
    template: Template,
    config: GenerativeConfig,
) -> tuple[jax.Array, dict[str, jax.Array]]:
    """Return the batch's mean loss and its terms; the key is consumed by the reparameterised samples."""

    noise_key, sample_key = jax.random.split(key)
    V_in = batch.V_star
    if config.input_noise:
        V_in = V_in + config.input_noise * jax.random.normal(noise_key, V_in.shape)
    code = encode(params, V_in, template=template, config=config)
    sample = code.mean + jnp.exp(0.5 * code.log_variance) * jax.random.normal(sample_key, code.mean.shape)
    decoded = decode(params, sample, template=template, config=config)
    terms = generative_terms(
        code, decoded, batch.V_star, batch.T_tilde_star, template=template, config=config
    )
    kl = kl_per_dimension(code)
    square = 1e4 * jnp.square(decoded.V - batch.V_star).sum(axis=-1).mean(axis=-1)
    metrics = {name: value.mean() for name, value in terms.items()}
    loss = sum(metrics.values(), jnp.zeros(()))
    live = (kl.mean(axis=0) > LIVE_NATS).sum()
    return loss, {**metrics, "loss": loss, "rmse_cm": jnp.sqrt(square.mean()), "live_dimensions": live}


def make_generative_train_step(
    template: Template, config: GenerativeConfig, optimiser: optax.GradientTransformation
) -> Callable[[TrainState, GenerativeBatch], tuple[TrainState, dict[str, jax.Array]]]:
    """Return the jitted step (state, batch) -> (state, metrics); the state's buffers are donated."""

    def step(state: TrainState, batch: GenerativeBatch):
        key, used = jax.random.split(state.key)
        gradient, metrics = jax.grad(generative_loss, has_aux=True)(
            state.params, used, batch, template=template, config=config
        )
        updates, opt_state = optimiser.update(gradient, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        metrics["gradient_norm"] = optax.tree.norm(gradient)
        return TrainState(params, opt_state, key, state.step + 1), metrics

    return jax.jit(step, donate_argnums=0)
