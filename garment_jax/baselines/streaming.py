"""A causal method in the engine of `infer.py`: chunks in the world, motions side by side, single frames."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from garment_jax.animation.clips import Rollout, rollout_batch
from garment_jax.animation.frame_method import FrameMethod, stream_motion, whole_inputs
from garment_jax.animation.stream import Chunk, PostprocessStream
from garment_jax.baselines.fitting import fitted_model
from garment_jax.baselines.method import Runner, Stream
from garment_jax.body.root_frame import headings
from garment_jax.body.seeds import Seeds
from garment_jax.config import CollisionConfig
from garment_jax.dataset.template import Template
from garment_jax.io.content_hash import rollout_hash
from garment_jax.model.store import Model, check_rate, template_for
from garment_jax.structs import Motion, Scene

# (model, scene, template and seeds of `template_for`) -> the method on that scene
MethodOn = Callable[[Model, Scene, Template, Seeds], FrameMethod]


class _OnScene(NamedTuple):
    method: FrameMethod
    postprocess: PostprocessStream
    rollout: Rollout  # compiled
    step: Rollout  # compiled


class _Streamed:
    """A model on any scene of its garment; a scene's programs are compiled once, whatever the motions."""

    def __init__(self, model: Model, method_on: MethodOn, collision: bool) -> None:
        self._model, self._method_on, self._collision = model, method_on, collision
        self._scenes: dict[str, _OnScene] = {}

    def animate(self, scene: Scene, motion: Motion, name: str) -> Iterator[Chunk]:
        made = self._on(scene, name, motion)
        pieces = stream_motion(made.method, made.rollout, motion)
        yield from made.postprocess(motion, motion.root.astype(np.float64), headings(motion), pieces)

    def rollout_batch(self, scene: Scene, motions: Sequence[Motion], name: str) -> list[np.ndarray]:
        made = self._on(scene, name, *motions)
        state = jax.tree.map(lambda *leaves: np.stack(leaves), *map(made.method.init, motions))
        x = [whole_inputs(made.method, motion) for motion in motions]
        chunk = self._model.config.rollout.chunk
        return rollout_batch(made.rollout, made.method.params, state, x, chunk=chunk)

    def stream(self, scene: Scene, motion: Motion, name: str) -> Stream:
        method, _, rollout, step = self._on(scene, name, motion)
        return Stream(
            whole_inputs(method, motion),
            method.init(motion),
            lambda state, x: step(method.params, state, x),
            lambda state, x: rollout(method.params, state, x),
            motion.root.astype(np.float64),
            headings(motion),
        )

    def _on(self, scene: Scene, name: str, *motions: Motion) -> _OnScene:
        for motion in motions:
            check_rate(self._model, motion, name)
        key = rollout_hash(scene)
        if key not in self._scenes:
            model = self._model
            template, seeds = template_for(model, scene, name)
            method = self._method_on(model, scene, template, seeds)
            postprocess = PostprocessStream(model.config, scene, template, collision=self._collision)
            compiled = jax.jit(method.rollout), jax.jit(method.step)
            self._scenes[key] = _OnScene(method, postprocess, *compiled)
        return self._scenes[key]


def make_runner(model: Model, method_on: MethodOn, *, collision: bool) -> Runner:
    """Return the runner of a causal method; what comes after it is as `model.config` says.

    Without `collision` limbs and collisions are left as they come.
    """
    made = _Streamed(model, method_on, collision)
    return Runner(model.params, count(model.params), made.animate, made.rollout_batch, made.stream)


def load_runner(
    method_on: MethodOn, run_dir: Path, collision: CollisionConfig | None = None, lengths: bool = False
) -> Runner:
    """Return the runner of a fitted baseline's folder.

    `collision`: handle limbs and collisions so; without it they are left as they come, and so are edges
    without `lengths`. Raises `FileNotFoundError` before the fit has ended.
    """
    model = fitted_model(run_dir)
    config = replace(model.config, rollout=replace(model.config.rollout, lengths=lengths))
    config = config if collision is None else replace(config, collision=collision)
    return make_runner(model._replace(config=config), method_on, collision=collision is not None)


def count(params: Any) -> int:
    """Return how many numbers `params` hold."""
    return sum(int(np.size(leaf)) for leaf in jax.tree.leaves(params))
