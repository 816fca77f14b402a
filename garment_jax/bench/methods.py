"""Ours and the baselines behind one door: train a row's run, load it as a runner."""

from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.animation.network_method import network_method
from garment_jax.baselines import METHODS, Runner
from garment_jax.baselines.streaming import make_runner
from garment_jax.bench.settings import OURS, Row
from garment_jax.bench.sharing import share_stages
from garment_jax.body.root_frame import from_root, to_root
from garment_jax.config import Config
from garment_jax.dataset.lanes import repeated_last
from garment_jax.dataset.motion_input import motion_input
from garment_jax.model.generative.canonical import posed, unposed
from garment_jax.model.generative.network import decode, encode
from garment_jax.model.store import (
    Model,
    save_model,
    template_for,
    without_column_rnn,
)
from garment_jax.structs import FrameInput, Motion, Scene
from garment_jax.training.pipeline import train, trained_model

BATCH = 32  # frames encoded and decoded at a time


def fit(method: str, config: Config, run: Path, data_dir: Path, *, data: str) -> None:
    """Train `method` in the folder `run`; goes on where it stopped. `data`: the hash of the clips."""
    if method == OURS:
        share_stages(run, run.parent, config, data)
        train(config, run, data_dir=data_dir)
    else:
        METHODS[method].fit(config, run, data_dir)


def load(row: Row, run: Path, config: Config) -> Runner:
    """Return the runner of a trained row; `config` (the row's) says what comes after the networks."""
    if row.method != OURS:
        return METHODS[row.method].load(
            run, config.collision if row.collision else None, config.rollout.lengths
        )
    model = trained_model(run)
    model = model._replace(config=config, params=_rounded(model.params, row.precision))
    networks = partial(network_method, detail=row.detail)
    runner = make_runner(model, networks, collision=row.collision)
    return runner._replace(
        reconstruct=lambda scene, motion, V, name: reconstructed(model, scene, motion, V, name)
    )


def stored_bytes(row: Row, run: Path, folder: Path) -> int:
    """Return the size of the model as it is stored, in bytes; `folder` is written over."""
    model = run / "model"
    if row.method == OURS:
        model = save_model(trained_model(run), folder, bits=16 if row.precision == "bfloat16" else 32)
    return sum(path.stat().st_size for path in model.rglob("*") if path.is_file())


def _rounded(params: Any, precision: str) -> Any:
    """Return parameters as they come back from a file of that precision; the networks compute in 32 bits."""
    return jax.tree.map(lambda x: jnp.asarray(jnp.asarray(x, jnp.dtype(precision)), jnp.float32), params)


def reconstructed(model: Model, scene: Scene, motion: Motion, V: np.ndarray, name: str) -> np.ndarray:
    """Return the truth `V` `[t, n, 3]`, world metres, encoded by ours (the means of Z) and decoded."""
    template, seeds = template_for(without_column_rnn(model), scene, name)
    inputs = motion_input(motion, scene, seeds, model.config.body.motion_joints, seed_frames=1)
    params, config = model.params["generative"], model.config.generative
    local = to_root(V.astype(np.float64), inputs.root, inputs.yaw).astype(np.float32)

    @jax.jit
    def rebuild(V: jax.Array, x: FrameInput) -> jax.Array:
        mean = encode(params, unposed(V, x, template=template), template=template, config=config).mean
        return posed(decode(params, mean, template=template, config=config).V, x, template=template)

    def piece(first: int) -> jax.Array:
        few = jax.tree.map(lambda x: repeated_last(x[first : first + BATCH], BATCH), (local, inputs.x))
        return rebuild(*jax.tree.map(jnp.asarray, few))

    pieces = [piece(first) for first in range(0, len(local), BATCH)]
    rebuilt = np.concatenate([np.asarray(piece) for piece in pieces])[: len(local)]
    return from_root(rebuilt.astype(np.float64), inputs.root, inputs.yaw).astype(np.float32)
