"""A problem small enough to train in a test: noisy gradient descent on a least-squares fit.

As a program, `python toy.py RUN_DIR batch|save STEP`: trains with a checkpoint every 7 steps and ends
itself by SIGKILL, as `kill -9` would: while that batch is made, or in the middle of that save.
"""

import os
import signal
import sys
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from garment_jax.config import TrainingConfig
from garment_jax.training import checkpoint
from garment_jax.training.checkpoint import Checkpointer
from garment_jax.training.log import RunLog
from garment_jax.training.loop import run_stage
from garment_jax.training.optimiser import make_optimiser

STEPS = 60


class ToyState(NamedTuple):
    params: dict[str, jax.Array]
    opt_state: optax.OptState
    key: jax.Array  # typed key, consumed and replaced in each step
    carry: jax.Array  # [3] a running mean of the gradient, as a recurrent state would be


OPTIMISER = make_optimiser(TrainingConfig(), learning_rate=0.05, weight_decay=1e-3, steps=STEPS)


def first_state() -> ToyState:
    params = {"w": jnp.zeros(3), "b": jnp.zeros(())}
    return ToyState(params, OPTIMISER.init(params), jax.random.key(7), jnp.zeros(3))


def batch_at(step: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(step)
    x = rng.normal(size=(8, 3)).astype(np.float32)
    return x, (x @ np.array([1.0, -2.0, 0.5], np.float32) + 0.3).astype(np.float32)


@jax.jit
def step_fn(state: ToyState, batch: Any) -> tuple[ToyState, dict[str, jax.Array]]:
    x, y = batch
    key, noise_key = jax.random.split(state.key)

    def loss_of(params: dict[str, jax.Array]) -> jax.Array:
        noise = 0.1 * jax.random.normal(noise_key, y.shape)
        return jnp.mean((x @ params["w"] + params["b"] + noise - y) ** 2)

    loss, gradient = jax.value_and_grad(loss_of)(state.params)
    updates, opt_state = OPTIMISER.update(gradient, state.opt_state, state.params)
    params = optax.apply_updates(state.params, updates)
    return ToyState(params, opt_state, key, 0.9 * state.carry + 0.1 * gradient["w"]), {"loss": loss}


def train(run_dir: Path, *, batches: Any = batch_at, step: Any = step_fn, **options: Any) -> ToyState:
    checkpointer = Checkpointer(run_dir, "toy", metadata={"why": "a test"})
    options = {"checkpoint_every": 7, "log_every": 5, **options}
    with RunLog(run_dir) as log:
        return run_stage(
            "toy", first_state(), step, batches, steps=STEPS, checkpointer=checkpointer, logger=log, **options
        )


def _batch_or_kill(step: int) -> tuple[np.ndarray, np.ndarray]:
    if sys.argv[2:] == ["batch", str(step)]:
        os.kill(os.getpid(), signal.SIGKILL)
    return batch_at(step)


def _write_then_kill(partial: Path, *rest: Any) -> None:
    _WRITE(partial, *rest)
    if sys.argv[2:] == ["save", partial.stem]:
        os.kill(os.getpid(), signal.SIGKILL)


if __name__ == "__main__":
    _WRITE = checkpoint._write
    checkpoint._write = _write_then_kill
    train(Path(sys.argv[1]), batches=_batch_or_kill)
