"""The train step of the detail enhancement (paper 3.4): generator and discriminator side by side.

Parameters and optimiser state are dicts by player, {"G": G_de, "D": D_ms}. Without an adversarial term
(`config.lambda_adversarial` = 0) there is no "D": it is neither built nor run.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax

from garment_jax.config import DetailConfig, GenerativeConfig
from garment_jax.dataset.template import Template
from garment_jax.model.detail.discriminator import discriminate, init_discriminator
from garment_jax.model.detail.losses import adversarial_term, detail_terms, discriminator_loss
from garment_jax.model.detail.network import enhance, init_detail
from garment_jax.structs import TrainState


class DetailBatch(NamedTuple):
    """Garments to enhance, as the first two stages leave them."""

    V: jax.Array  # [B, n, 3] metres, root frame
    Z: jax.Array  # [B, latent]
    V_star: jax.Array  # [B, n, 3] metres, root frame


def init_players(
    key: jax.Array, template: Template, *, config: DetailConfig, generative: GenerativeConfig
) -> dict[str, dict]:
    """Return fresh parameters {"G": ..., "D": ...}, or G alone; the key is consumed."""
    G_key, D_key = jax.random.split(key)
    params = {"G": init_detail(G_key, template, config=config, generative=generative)}
    if config.lambda_adversarial:
        params["D"] = init_discriminator(D_key, template, config=config)
    return params


def side_by_side(
    optimisers: Mapping[str, optax.GradientTransformation],
) -> optax.GradientTransformation:
    """Return one transformation in which each player has an optimiser of its own (clipping included).

    Takes parameters with any of the `optimisers`' names; an absent player's optimiser is left out.
    """

    def init(params: Any) -> dict:
        return {name: optimisers[name].init(params[name]) for name in params}

    def update(updates: Any, state: Any, params: Any = None) -> tuple[dict, dict]:
        moves, new = {}, {}
        for name in updates:
            own = None if params is None else params[name]
            moves[name], new[name] = optimisers[name].update(updates[name], state[name], own)
        return moves, new

    return optax.GradientTransformation(init, update)


def players_loss(
    params: dict, batch: DetailBatch, *, template: Template, config: DetailConfig
) -> tuple[jax.Array, dict[str, jax.Array]]:
    """Return the sum of both players' losses, each a function of its own parameters alone, and the terms.

    So one gradient serves both: G's loss sees D's parameters cut, D's loss sees V_f cut.
    """
    V_f = enhance(params["G"], batch.V, batch.Z, template=template, config=config)
    terms = detail_terms(V_f, batch.V_star, template=template, config=config)
    metrics = {name: value.mean() for name, value in terms.items()}
    total = jnp.zeros(())
    if "D" in params:
        frozen = jax.lax.stop_gradient(params["D"])
        judged = discriminate(frozen, V_f, template=template, config=config)
        metrics["adversarial"] = adversarial_term(judged, config=config)
        real = discriminate(params["D"], batch.V_star, template=template, config=config)
        fake = discriminate(params["D"], jax.lax.stop_gradient(V_f), template=template, config=config)
        total = discriminator_loss(real, fake)
    loss = sum(metrics.values(), jnp.zeros(()))
    metrics["loss"] = loss
    if "D" in params:
        metrics |= {"discriminator": total, "score_real": _mean(real), "score_fake": _mean(fake)}
    metrics["rmse_before_cm"] = _rmse_cm(batch.V, batch.V_star)
    metrics["rmse_cm"] = _rmse_cm(V_f, batch.V_star)
    return loss + total, metrics


def _mean(scores: tuple[jax.Array, ...]) -> jax.Array:
    return jnp.stack([score.mean() for score in scores]).mean()


def _rmse_cm(V: jax.Array, V_star: jax.Array) -> jax.Array:
    return 100.0 * jnp.sqrt(jnp.square(V - V_star).sum(axis=-1).mean())


def make_detail_train_step(
    template: Template, config: DetailConfig, optimiser: optax.GradientTransformation
) -> Callable[[TrainState, DetailBatch], tuple[TrainState, dict[str, jax.Array]]]:
    """Return the jitted step (state, batch) -> (state, metrics); the state's buffers are donated.

    `optimiser` is `side_by_side({"G": ..., "D": ...})`; `state.params` as from `init_players`. Both players
    move at once, from the same parameters. The state's key passes through unused.
    """

    def step(state: TrainState, batch: DetailBatch):
        gradient, metrics = jax.grad(players_loss, has_aux=True)(
            state.params, batch, template=template, config=config
        )
        updates, opt_state = optimiser.update(gradient, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        metrics["gradient_norm"] = optax.tree.norm(gradient["G"])
        if "D" in gradient:
            metrics["gradient_norm_D"] = optax.tree.norm(gradient["D"])
        return TrainState(params, opt_state, state.key, state.step + 1, state.carry), metrics

    return jax.jit(step, donate_argnums=0)
