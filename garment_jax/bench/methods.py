"""Ours and the baselines behind one door: train a row's run, load it as a runner."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.animation.animate import Animator, make_animator
from garment_jax.animation.clips import rollout_batch
from garment_jax.animation.stream import Chunk
from garment_jax.baselines import METHODS, Runner, Stream
from garment_jax.bench.settings import OURS, Row
from garment_jax.bench.sharing import share_stages
from garment_jax.body.root_frame import from_root, to_root
from garment_jax.config import Config
from garment_jax.dataset.lanes import repeated_last
from garment_jax.dataset.motion_input import motion_input
from garment_jax.io.content_hash import rollout_hash
from garment_jax.model.compose import init_state, step
from garment_jax.model.generative.canonical import posed, unposed
from garment_jax.model.generative.network import decode, encode
from garment_jax.model.scan import make_rollout
from garment_jax.model.store import (
    Model,
    model_input,
    save_model,
    skinned_template,
    template_for,
    without_column_rnn,
)
from garment_jax.structs import FrameInput, Motion, Scene
from garment_jax.training.pipeline import train, trained_model

TITLES = {OURS: "ours"} | {name: method.title for name, method in METHODS.items()}
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
    count = sum(int(np.size(leaf)) for leaf in jax.tree.leaves(model.params))
    return Runner(
        model.params,
        count,
        _animate(model, row),
        _rollout_batch(model, row),
        _stream(model, row),
        lambda scene, motion, V, name: reconstructed(model, scene, motion, V, name),
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


def _animate(model: Model, row: Row) -> Callable[[Scene, Motion, str], Iterator[Chunk]]:
    made: dict[str, Animator] = {}  # the test clips share a scene: compiled once

    def run(scene: Scene, motion: Motion, name: str) -> Iterator[Chunk]:
        key = rollout_hash(scene)
        if key not in made:
            made[key] = make_animator(model, scene, detail=row.detail, collision=row.collision, name=name)
        return made[key](motion, name=name)

    return run


def _rollout_batch(model: Model, row: Row) -> Callable[[Scene, Sequence[Motion], str], list[np.ndarray]]:
    def run(scene: Scene, motions: Sequence[Motion], name: str) -> list[np.ndarray]:
        template, seeds = template_for(model, scene, name)
        inputs = [model_input(model, scene, template, seeds, m) for m in motions]
        start = jnp.stack([skinned_template(model, template, seeds, x) for x in inputs])
        return rollout_batch(
            make_rollout(template, model.config, detail=row.detail),
            model.params,
            init_state(model.params, start, template=template, config=model.config),
            [x.x for x in inputs],
            chunk=model.config.rollout.chunk,
        )

    return run


def _stream(model: Model, row: Row) -> Callable[[Scene, Motion, str], Stream]:
    """Return ours as a stream: the networks alone, one frame in and one out."""

    def begin(scene: Scene, motion: Motion, name: str) -> Stream:
        template, seeds = template_for(model, scene, name)
        x = model_input(model, scene, template, seeds, motion)
        run = make_rollout(template, model.config, detail=row.detail)
        one = jax.jit(
            lambda params, state, x: step(
                params, state, x, template=template, config=model.config, detail=row.detail
            )
        )
        start = skinned_template(model, template, seeds, x)
        state = init_state(model.params, start, template=template, config=model.config)
        return Stream(
            x.x,
            state,
            lambda state, x: one(model.params, state, x),
            lambda state, x: run(model.params, state, x),
            x.root,
            x.yaw,
        )

    return begin


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
