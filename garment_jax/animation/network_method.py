"""Our networks as a method of the streaming engine: the paper's latents, corrected by the column RNN."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.animation.frame_method import FrameMethod, in_chunks
from garment_jax.aot_cache import Program, ProgramStore, shapes_of
from garment_jax.body.frame_windows import AT_ONCE
from garment_jax.body.seeds import Seeds
from garment_jax.dataset.motion_input import frame_inputs, motion_input
from garment_jax.dataset.start import make_start
from garment_jax.dataset.template import Template
from garment_jax.model.compose import RolloutState, init_state, step
from garment_jax.model.scan import rollout
from garment_jax.model.store import Model
from garment_jax.structs import FrameInput, Motion, Scene


def network_method(
    model: Model, scene: Scene, template: Template, seeds: Seeds, *, detail: bool = True
) -> FrameMethod:
    """Return the networks on a scene; `template` and `seeds` are from `template_for`.

    It makes their inputs as it goes, `AT_ONCE` frames at a time: a long motion's would fill the memory.
    A model without a column RNN (`without_column_rnn`) does not even import it.
    """
    chunk, joints = model.config.rollout.chunk, model.config.body.motion_joints
    length, look = chunk * -(-AT_ONCE // chunk), None
    start = make_motion_start(model, scene, template, seeds)
    if template.ring is not None:
        from garment_jax.model.column_rnn.rollout import seen_in

        look = partial(seen_in, scene, template.ring, chunk)

    def init(motion: Motion) -> RolloutState:
        return init_state(model.params, start(motion), template=template, config=model.config)

    def inputs(motion: Motion) -> Iterator[FrameInput]:
        frames = len(motion.root)
        for first in range(0, frames, length):
            x = frame_inputs(motion, scene, joints, slice(first, min(first + length, frames)))
            for k, piece in enumerate(in_chunks(x, chunk)):
                yield piece if look is None else piece._replace(column_rnn=look(motion, first + k * chunk))

    options = {"template": template, "config": model.config, "detail": detail}
    return FrameMethod(model.params, init, inputs, partial(step, **options), partial(rollout, **options))


def make_motion_start(
    model: Model, scene: Scene, template: Template, seeds: Seeds
) -> Callable[[Motion], jax.Array]:
    """Return a function of a motion: the skinned template in its first frame, `[n, 3]` metres.

    In the networks' frame: in canonical pose that is the template itself.
    """
    skinned = make_start(template, seeds, model.config.body.tau)

    def start(motion: Motion) -> jax.Array:
        first = Motion(motion.rotations[:1], motion.root[:1], motion.fps)
        x = motion_input(first, scene, seeds, model.config.body.motion_joints)
        return skinned(x.R_seed, x.t_seed)[0]

    return start


def compile_networks(
    method: FrameMethod,
    model: Model,
    scene: Scene,
    template: Template,
    *,
    programs: ProgramStore,
    facts: dict[str, Any],
) -> Program:
    """Return `method.rollout` of a chunk as a program that begins to compile at once.

    `facts`: all that it depends on besides the shapes, by which the program is kept.
    """
    V = jnp.zeros((model.vertices, 3))
    state = init_state(model.params, V, template=template, config=model.config)
    frames = _still(model.config.rollout.chunk, len(model.statistics.motion_mean), len(scene.body.joints))
    if template.ring is not None:
        from garment_jax.model.column_rnn.rollout import unseen

        frames = frames._replace(column_rnn=unseen(template.ring, model.config.rollout.chunk))
    example = shapes_of((model.params, state, frames))
    return programs.program("rollout", jax.jit(method.rollout), example, facts)


def _still(chunk: int, d: int, j: int) -> FrameInput:
    """Return frames of zeros in the shapes of a chunk's, to compile with."""
    shapes = ((d,), (3, 3), (3,), (j, 3, 3), (j, 3))
    M, turn, shift, R, t = (np.zeros((chunk, *shape), np.float32) for shape in shapes)
    return FrameInput(M, turn, shift, R, t)
