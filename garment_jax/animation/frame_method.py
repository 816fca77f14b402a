"""The contract of every causal method, networks and baselines alike, and a motion streamed through it."""

from collections.abc import Callable, Iterator
from operator import itemgetter
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from garment_jax.animation.clips import Rollout, frame_count, stack_motions
from garment_jax.structs import Motion


class FrameMethod(NamedTuple):
    """A method on one scene: `state = init(motion)`, then `state, V = step(params, state, x)` for each frame.

    `step` and `rollout` are pure, their leading axes `*b` motions side by side; `init` and `inputs` are the
    host's.
    """

    params: PyTree
    init: Callable[[Motion], PyTree]  # the state before a motion's first frame, without a motion axis
    inputs: Callable[[Motion], Iterator[PyTree]]  # what `step` reads, in padded chunks: leaves [chunk, ...]
    step: Rollout  # (params, state, x [*b, ...]) -> (state, V [*b, n, 3] metres, root frames)
    rollout: Rollout  # `step` over x [t, *b, ...]; what needs no state is computed for all frames at once


def stream_motion(method: FrameMethod, rollout: Rollout, motion: Motion) -> Iterator[tuple[int, jax.Array]]:
    """Yield `(first frame, V [chunk, n, 3])` of a motion, metres, root frames.

    `rollout` is the method's, compiled. The last chunk is padded.
    """
    state, first = method.init(motion), 0
    for x in method.inputs(motion):
        state, V = rollout(method.params, state, x)
        yield first, V
        first += len(V)


def whole_inputs(method: FrameMethod, motion: Motion) -> PyTree:
    """Return what `step` reads of all of a motion's frames, leaves `[t, ...]`."""
    return jax.tree.map(lambda *x: np.concatenate(x)[: len(motion.root)], *method.inputs(motion))


def in_chunks(x: PyTree, chunk: int) -> Iterator[PyTree]:
    """Yield a motion's inputs (leaves `[t, ...]`) in chunks, the last one padded as by `stack_motions`."""
    padded = stack_motions([x], chunk)
    for start in range(0, frame_count(padded), chunk):
        yield jax.tree.map(itemgetter((slice(start, start + chunk), 0)), padded)


def step_of(rollout: Rollout) -> Rollout:
    """Return one frame of `rollout`, without its time axis."""

    def step(params: PyTree, state: PyTree, x: PyTree) -> tuple[PyTree, jax.Array]:
        state, V = rollout(params, state, jax.tree.map(lambda leaf: leaf[None], x))
        return state, V[0]

    return step
