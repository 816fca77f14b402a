"""A causal method on one scene as a stream, as chunks in the world, and side by side over motions."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import numpy as np

from garment_jax.animation.clips import Rollout, rollout_chunks, stack_motions
from garment_jax.animation.clips import rollout_batch as roll_side_by_side
from garment_jax.animation.stream import Chunk, PostprocessStream
from garment_jax.baselines.method import Runner, Stream
from garment_jax.config import CollisionConfig
from garment_jax.dataset.template import scene_template
from garment_jax.io.content_hash import rollout_hash
from garment_jax.model.store import Model, check_rate
from garment_jax.structs import Motion, Scene


class Beginning(NamedTuple):
    """A motion as a method reads it."""

    x: Any  # leaves [t, ...] float32
    state: Any  # before the first frame; leaves without a motion axis
    root: np.ndarray  # [t, 3] float64 metres
    yaw: np.ndarray  # [t] radians


class Live(NamedTuple):
    """A method on one scene: the host's part and the pure part."""

    begin: Callable[[Motion], Beginning]
    rollout: Rollout


class _Compiled(NamedTuple):
    live: Live
    postprocess: PostprocessStream
    run: Rollout  # of a chunk
    step: Rollout  # of a frame, without a time axis


def _compile(live: Live, postprocess: PostprocessStream) -> _Compiled:
    def one(params: Any, state: Any, x: Any) -> tuple[Any, jax.Array]:
        state, V = live.rollout(params, state, jax.tree.map(lambda leaf: leaf[None], x))
        return state, V[0]

    return _Compiled(live, postprocess, jax.jit(live.rollout), jax.jit(one))


def make_runner(
    model: Model,
    live_on: Callable[[Model, Scene, str], Live],
    collision: CollisionConfig | None = None,
    lengths: bool = False,
) -> Runner:
    """Return the runner of a motion-driven method; `live_on` refuses a scene of another garment.

    `collision`: handle limbs and collisions as for ours; without it they are left as they come, and so are
    edges without `lengths`.
    """
    chunk, known = model.config.rollout.chunk, dict[str, _Compiled]()
    config = replace(model.config, rollout=replace(model.config.rollout, lengths=lengths))
    config = config if collision is None else replace(config, collision=collision)

    def compiled(scene: Scene, name: str) -> _Compiled:
        """Programs are compiled once for a scene, whatever the clips."""
        key = rollout_hash(scene)
        if key not in known:
            template = scene_template(scene, model.statistics, config)
            postprocess = PostprocessStream(config, scene, template, collision=collision is not None)
            known[key] = _compile(live_on(model, scene, name), postprocess)
        return known[key]

    def stream(scene: Scene, motion: Motion, name: str) -> Stream:
        made = compiled(scene, name)
        check_rate(model, motion, name)
        first = made.live.begin(motion)
        return Stream(
            first.x,
            first.state,
            lambda state, x: made.step(model.params, state, x),
            lambda state, x: made.run(model.params, state, x),
            first.root,
            first.yaw,
        )

    def animate(scene: Scene, motion: Motion, name: str) -> Iterator[Chunk]:
        made = stream(scene, motion, name)
        x = one_motion(made.x, chunk)
        pieces = rollout_chunks(compiled(scene, name).run, model.params, made.state, x, chunk=chunk)
        yield from compiled(scene, name).postprocess(motion, made.root, made.yaw, pieces)

    def rollout_batch(scene: Scene, motions: Sequence[Motion], name: str) -> list[np.ndarray]:
        made = compiled(scene, name)
        for motion in motions:
            check_rate(model, motion, name)
        begun = [made.live.begin(motion) for motion in motions]
        state = jax.tree.map(lambda *leaves: np.stack(leaves), *(b.state for b in begun))
        return roll_side_by_side(made.run, model.params, state, [b.x for b in begun], chunk=chunk)

    return Runner(model.params, count(model.params), animate, rollout_batch, stream)


def count(params: Any) -> int:
    """Return how many numbers `params` hold."""
    return sum(int(np.size(leaf)) for leaf in jax.tree.leaves(params))


def one_motion(x: Any, chunk: int) -> Any:
    """Return a motion's inputs (leaves `[t, ...]`) padded to a multiple of `chunk` frames."""
    return jax.tree.map(lambda leaf: leaf[:, 0], stack_motions([x], chunk)[0])
