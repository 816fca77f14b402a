"""Optimisers and learning-rate schedules, built from the configuration."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax

from garment_jax.config import TrainingConfig


class Schedule(NamedTuple):
    """The numbers of a schedule, and the step that comes next.

    They are part of the optimiser's state, not constants of its program: one of other steps or another rate
    compiles to the same program.
    """

    count: jax.Array  # steps behind
    rate: jax.Array  # the highest
    rise: jax.Array  # steps until that
    steps: jax.Array


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
    begin = partial(make_schedule, training, learning_rate=learning_rate, steps=steps)
    decay = optax.add_decayed_weights(weight_decay)
    adam = optax.scale_by_adam(b1=0.9, b2=0.999, eps=1e-8)
    clip = optax.clip_by_global_norm(training.clip_norm) if training.clip_norm > 0 else optax.identity()
    inner = (decay, adam) if training.optimiser == "adam_l2" else (adam, decay)

    def scale(updates: Any, state: Any, params: Any = None) -> tuple[Any, Schedule]:
        rate = rate_at(training, state)
        return jax.tree.map(lambda x: -rate * x, updates), state._replace(count=state.count + 1)

    return optax.chain(clip, *inner, optax.GradientTransformation(lambda params: begin(), scale))


def make_schedule(training: TrainingConfig, *, learning_rate: float, steps: int) -> Schedule:
    """Return the schedule at its first step; the rise takes round(warmup x steps) steps."""
    rise = round(training.warmup * steps)
    return Schedule(jnp.int32(0), jnp.float32(learning_rate), jnp.int32(rise), jnp.int32(steps))


def rate_at(training: TrainingConfig, schedule: Schedule) -> jax.Array:
    """Return the next step's rate: a linear rise, then constant or half a cosine down to `final_rate`.

    The rise does not begin at 0, so no step is wasted.
    """
    count, rate, rise, steps = schedule
    fall = jnp.float32(1.0)
    if training.schedule == "cosine":
        part = jnp.clip((count - rise) / jnp.maximum(steps - rise, 1), 0.0, 1.0)
        low = training.final_rate
        fall = low + (1 - low) * 0.5 * (1 + jnp.cos(jnp.pi * part))
    return rate * jnp.where(count < rise, (count + 1) / jnp.maximum(rise, 1), fall)
