"""Means of late parameters against a loop over every step's, and over a run that is stopped and goes on."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.structs import TrainState
from garment_jax.training.average import with_average
from garment_jax.training.checkpoint import Checkpointer
from garment_jax.training.log import RunLog
from garment_jax.training.loop import run_stage

STEPS = 10


@jax.jit
def _step(state: TrainState, batch: np.ndarray) -> tuple[TrainState, dict[str, jax.Array]]:
    gradient = {"w": state.params["w"] - batch}
    params = jax.tree.map(lambda p, g: p - 0.3 * g, state.params, gradient)
    return TrainState(params, (), state.key, state.step + 1), {"loss": jnp.square(gradient["w"]).sum()}


def first() -> TrainState:
    return TrainState({"w": jnp.zeros(3)}, (), jax.random.key(0), jnp.int32(0))


def batch_at(step: int) -> np.ndarray:
    return np.random.default_rng(step).normal(size=3).astype(np.float32)


def every_step() -> list[np.ndarray]:
    state, found = first(), []
    for step in range(STEPS):
        state, _ = _step(state, batch_at(step))
        found.append(np.asarray(state.params["w"]))
    return found


@pytest.mark.parametrize(("part", "kept"), [(0.4, 4), (1.0, 10), (0.01, 1)])
def test_the_mean_is_over_the_parameters_after_each_of_the_last_steps(part: float, kept: int) -> None:
    state, step = with_average(first(), _step, steps=STEPS, part=part)
    found = every_step()
    for k in range(STEPS):
        state, _ = step(state, batch_at(k))
        late = found[STEPS - kept : k + 1] or [found[k]]  # before the last steps: the newest alone
        np.testing.assert_allclose(state.params["w"], np.mean(late, axis=0), rtol=1e-5, atol=1e-7)
        np.testing.assert_array_equal(state.training.params["w"], found[k])


def test_a_run_that_goes_on_ends_with_the_same_mean_and_stores_it(tmp_path: Path) -> None:
    def run(folder: Path, stop: int) -> np.ndarray:
        state, step = with_average(first(), _step, steps=STEPS, part=0.6)
        saved = Checkpointer(folder, "toy")
        with RunLog(folder) as log:
            last = run_stage("toy", state, step, batch_at, steps=stop, checkpointer=saved, logger=log)
        np.testing.assert_array_equal(saved.tree("params")["w"], last.params["w"])
        return np.asarray(last.params["w"])

    run(tmp_path / "stopped", 7)
    np.testing.assert_array_equal(run(tmp_path / "stopped", STEPS), run(tmp_path / "whole", STEPS))
