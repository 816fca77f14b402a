"""Optimisers and learning-rate schedules, built from the configuration."""

import optax

from garment_jax.config import TrainingConfig


def make_optimiser(
    training: TrainingConfig,
    *,
    learning_rate: float,
    weight_decay: float,
    steps: int,
) -> optax.GradientTransformation:
    """Global-norm clipping, then Adam with the configured weight decay and schedule.

    "adamw" shrinks every parameter by rate x decay, "adam_l2" (PyTorch's Adam) adds decay x parameter to its
    gradient. The paper names Adam with a weight decay of 1e-3 (section 4, implementation) and not which.
    """
    rate = make_schedule(training, learning_rate=learning_rate, steps=steps)
    decay = optax.add_decayed_weights(weight_decay)
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
