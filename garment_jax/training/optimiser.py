"""Optimisers and learning-rate schedules, built from the configuration."""

from typing import Any

import jax
import jax.numpy as jnp
import optax

from garment_jax.config import TrainingConfig

WEIGHT_DECAY_MEANING = {
    "adamw": "decoupled (AdamW): the parameter shrinks by rate x decay, apart from the gradient",
    "adam_l2": "L2 (as PyTorch's Adam): decay x parameter is added to the gradient",
}


def make_optimiser(
    training: TrainingConfig,
    *,
    learning_rate: float,
    weight_decay: float,
    steps: int,
    decay_mask: Any = None,
) -> optax.GradientTransformation:
    """Global-norm clipping, then Adam with the configured weight decay and schedule.

    Which decay: `WEIGHT_DECAY_MEANING[training.optimiser]`. The paper names Adam with a
    weight decay of 1e-3 (section 4, implementation) and not which; PyTorch's is "adam_l2".
    `decay_mask` is a pytree of booleans or a function params -> such a pytree (for example
    `decay_weights_only`); None decays everything, as PyTorch does.
    """
    rate = make_schedule(training, learning_rate=learning_rate, steps=steps)
    decay = optax.add_decayed_weights(weight_decay, mask=decay_mask)
    adam = optax.scale_by_adam(b1=0.9, b2=0.999, eps=1e-8)
    clip = optax.clip_by_global_norm(training.clip_norm) if training.clip_norm > 0 else optax.identity()
    inner = (decay, adam) if training.optimiser == "adam_l2" else (adam, decay)
    return optax.chain(clip, *inner, optax.scale_by_learning_rate(rate))


def make_schedule(training: TrainingConfig, *, learning_rate: float, steps: int) -> optax.Schedule:
    """Learning rate by step: a linear rise, then constant or half a cosine down to `final_rate`.

    The rise takes round(warmup x steps) steps and does not begin at 0, so no step is wasted.
    """
    rise = round(training.warmup * steps)
    if training.schedule == "cosine":
        main = optax.cosine_decay_schedule(learning_rate, max(steps - rise, 1), alpha=training.final_rate)
    else:
        main = optax.constant_schedule(learning_rate)
    if rise == 0:
        return main
    first = optax.linear_schedule(learning_rate / rise, learning_rate, max(rise - 1, 1))
    return optax.join_schedules([first, main], [rise])


def decay_weights_only(params: Any) -> Any:
    """A mask that is True for kernels (two axes or more) and False for biases and norm scales."""
    return jax.tree.map(lambda leaf: jnp.ndim(leaf) >= 2, params)
