"""Stage 1: the garment generative model (paper 3.2)."""

from collections.abc import Callable
from functools import partial
from operator import itemgetter

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.dataset.batches import random_frames, spread_frames
from garment_jax.dataset.prepared import unposed_targets_of
from garment_jax.model.generative.canonical import posed
from garment_jax.model.generative.network import decode, encode, init_generative
from garment_jax.model.generative.principal import begin_linear
from garment_jax.model.generative.train_step import GenerativeBatch, make_generative_train_step
from garment_jax.structs import FrameInput
from garment_jax.training.pretrained import load_pretrained
from garment_jax.training.run import Run, checkpointer, optimise, say

START_FRAMES = 2_400  # frames whose principal components the model begins from


def train_generative(run: Run) -> dict:
    """Return the trained parameters; goes on from the newest checkpoint."""
    config, seed = run.config.generative, run.config.training.seed
    rows = run.devices.rows(config.batch)
    return optimise(
        run,
        "generative",
        begin_generative(run),
        partial(make_generative_train_step, run.template, config),
        lambda step: GenerativeBatch(*random_frames(run.data, config.batch, seed=seed, step=step, rows=rows)),
        steps=config.steps,
        learning_rate=config.learning_rate,
        weight_decay=config.weight_decay,
        seed=seed + 1,
        frames_per_step=config.batch,
        validate=_validation(run),
    )


def begin_generative(run: Run) -> dict:
    """Return the parameters that stage 1 begins from.

    Where there is a checkpoint only their structure is wanted, so the principal components are left out.
    """
    config = run.config.generative
    params = init_generative(jax.random.key(run.config.training.seed), run.template, config=config)
    folder = run.config.training.begin_from
    if folder:
        return load_pretrained(folder, "generative", params)
    if not config.linear_skip or checkpointer(run, "generative").latest() is not None:
        return params
    V = spread_frames(run.data, START_FRAMES)
    T_tilde = spread_frames(run.data, START_FRAMES, unposed_targets_of)
    say(f"generative: principal components of {len(V)} frames")
    return begin_linear(params, V, T_tilde, template=run.template, config=config)


def _validation(run: Run) -> Callable[[dict], dict[str, float]] | None:
    """Return a function that reconstructs every fourth frame of the clips kept back: RMSE in cm."""
    if not run.data.validation:
        return None
    config = run.config.generative

    @jax.jit
    def error(params: dict, V: jax.Array, U: jax.Array, x: FrameInput) -> jax.Array:
        mean = encode(params, U, template=run.template, config=config).mean
        rebuilt = decode(params, mean, template=run.template, config=config).V
        E = posed(rebuilt, x, template=run.template) - V
        return 1e4 * jnp.square(E).sum(axis=-1).mean(axis=-1)  # [k] of each frame

    def validate(params: dict) -> dict[str, float]:
        errors = {}
        for clip in run.data.validation:
            every = jax.tree.map(lambda leaf: np.asarray(leaf[::4]), (clip.V, clip.U, clip.input.x))
            count = len(every[0])
            # the last batch begins earlier, to be of one size; what it repeats is not counted again
            size, square = min(16, count), np.zeros(count)
            for i in range(0, count, size):
                window = slice(min(i, count - size), min(i, count - size) + size)
                square[window] = error(params, *jax.tree.map(itemgetter(window), every))
            errors[f"{clip.name}_rmse_cm"] = float(np.sqrt(square.mean()))
        return {"rmse_cm": float(np.mean(list(errors.values()))), **errors}

    return validate
