"""The mean of a stage's parameters over its last steps (Polyak and Juditsky 1992; not in the paper)."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax

from garment_jax.structs import TrainState
from garment_jax.training.loop import StepFn


class AveragedState(NamedTuple):
    """A training's state beside the mean that is used in its place."""

    params: Any  # the mean so far; before it begins, the newest parameters
    training: TrainState


def with_average(
    state: TrainState, step_fn: StepFn, *, steps: int, part: float
) -> tuple[AveragedState, StepFn]:
    """Return `state` and `step_fn` with the mean beside them, of the parameters after each of the last steps.

    `part` of all `steps`, one at least. The mean is part of the state, so a resumed run has the same.
    """
    before = steps - max(round(part * steps), 1)

    def mean(old: Any, new: Any, done: jax.Array) -> Any:
        return optax.incremental_update(new, old, 1.0 / jnp.maximum(done - before, 1))

    update = jax.jit(mean, donate_argnums=0)

    def step(state: AveragedState, batch: Any) -> tuple[AveragedState, Any]:
        training, metrics = step_fn(state.training, batch)
        return AveragedState(update(state.params, training.params, training.step), training), metrics

    copy = jax.tree.map(lambda leaf: jnp.array(leaf, copy=True), state.params)  # both are donated
    return AveragedState(copy, state), step
