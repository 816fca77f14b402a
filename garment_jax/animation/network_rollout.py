"""A motion through the networks, chunk by chunk: the codes (the paper's), corrected by the column RNN."""

from collections.abc import Callable, Iterator
from functools import partial
from operator import itemgetter
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.animation.clips import stack_motions
from garment_jax.aot_cache import ProgramStore, shapes_of
from garment_jax.body.frame_windows import AT_ONCE
from garment_jax.dataset.motion_input import frame_inputs
from garment_jax.dataset.template import Template
from garment_jax.model.compose import init_state
from garment_jax.model.scan import make_rollout
from garment_jax.model.store import Model
from garment_jax.structs import FrameInput, Motion, Scene

# (motion, V_start [n, 3] in the networks' frame) -> (first frame, V [chunk, n, 3] metres, root frames), ...
NetworkRollout = Callable[[Motion, jax.Array], Iterator[tuple[int, jax.Array]]]


def make_network_rollout(
    model: Model,
    scene: Scene,
    template: Template,
    *,
    detail: bool,
    programs: ProgramStore,
    facts: dict[str, Any],
) -> NetworkRollout:
    """Return the function that rolls motions out; it begins to compile at once.

    It makes the networks' inputs as it goes, `AT_ONCE` frames at a time: a long motion's would fill the
    memory. A model without a column RNN (`without_column_rnn`) does not even import it.
    """
    chunk, d = model.config.rollout.chunk, len(model.statistics.motion_mean)
    state = init_state(model.params, jnp.zeros((model.vertices, 3)), template=template, config=model.config)
    frames, look = _still(chunk, d, len(scene.body.joints)), None
    if template.ring is not None:
        from garment_jax.model.column_rnn.rollout import seen_in, unseen

        frames = frames._replace(column_rnn=unseen(template.ring, chunk))
        look = partial(seen_in, scene, template.ring, chunk)
    rolled = make_rollout(template, model.config, detail=detail)
    example = shapes_of((model.params, state, frames))
    roll = programs.program("rollout", rolled, example, {**facts, "detail": detail})

    joints, length = model.config.body.motion_joints, chunk * -(-AT_ONCE // chunk)

    def run(motion: Motion, V_start: jax.Array) -> Iterator[tuple[int, jax.Array]]:
        state = init_state(model.params, V_start, template=template, config=model.config)
        frames = len(motion.root)
        for first in range(0, frames, length):
            x = frame_inputs(motion, scene, joints, slice(first, min(first + length, frames)))
            x, _ = stack_motions([x], chunk)
            for start in range(0, len(x.M), chunk):
                piece = jax.tree.map(itemgetter((slice(start, start + chunk), 0)), x)
                piece = piece if look is None else piece._replace(column_rnn=look(motion, first + start))
                state, V = roll(model.params, state, piece)
                yield first + start, V

    return run


def _still(chunk: int, d: int, j: int) -> FrameInput:
    """Return frames of zeros in the shapes of a chunk's, to compile with."""
    shapes = ((d,), (3, 3), (3,), (j, 3, 3), (j, 3))
    M, turn, shift, R, t = (np.zeros((chunk, *shape), np.float32) for shape in shapes)
    return FrameInput(M, turn, shift, R, t)
