"""A motion through the networks, chunk by chunk: by codes (the paper's), or by the local dynamics."""

from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.data.motion_input import MotionInput
from garment_jax.data.template import Template
from garment_jax.programs import ProgramStore, shapes_of
from garment_jax.rollout.clips import rollout_chunks, stack_motions
from garment_jax.rollout.model import Model
from garment_jax.rollout.scan import make_rollout
from garment_jax.rollout.step import init_state
from garment_jax.structs import FrameInput, Motion, Scene

# (motion, its inputs, V_start [n, 3] in the networks' frame)
# -> (first frame, V [chunk, n, 3] in metres, root frames), ...
Roller = Callable[[Motion, MotionInput, jax.Array], Iterator[tuple[int, jax.Array]]]


def make_roller(
    model: Model,
    scene: Scene,
    template: Template,
    *,
    detail: bool,
    programs: ProgramStore,
    facts: dict[str, Any],
) -> Roller:
    """Return the function that rolls motions out; it begins to compile at once.

    A model that has local dynamics moves by them, another by its codes (`without_dynamics`); the other
    way's modules are not even imported.
    """
    make = _by_dynamics if "dynamics" in model.params else _by_codes
    return make(model, scene, template, detail, programs, facts)


def _by_codes(
    model: Model, scene: Scene, template: Template, detail: bool, programs: ProgramStore, facts: dict
) -> Roller:
    chunk, d = model.config.rollout.chunk, len(model.statistics.motion_mean)
    state = init_state(model.params, jnp.zeros((model.vertices, 3)), config=model.config)
    j = len(scene.body.joints)
    shapes = FrameInput((d,), (3, 3), (3,), (j, 3, 3), (j, 3))
    frames = FrameInput(*(np.zeros((chunk, *shape), np.float32) for shape in shapes))
    rolled = make_rollout(template, model.config, detail=detail)
    example = shapes_of((model.params, state, frames))
    roll = programs.program("rollout", rolled, example, {**facts, "detail": detail})

    def run(motion: Motion, inputs: MotionInput, V_start: jax.Array) -> Iterator[tuple[int, jax.Array]]:
        x, _ = stack_motions([inputs.x], chunk)
        single = jax.tree.map(lambda leaf: leaf[:, 0], x)
        state = init_state(model.params, V_start, config=model.config)
        yield from rollout_chunks(roll, model.params, state, single, chunk=chunk)

    return run


def _by_dynamics(
    model: Model, scene: Scene, template: Template, detail: bool, programs: ProgramStore, facts: dict
) -> Roller:
    from garment_jax.dynamics.pose import body_frames
    from garment_jax.dynamics.tables import make_dynamics_tables
    from garment_jax.rollout.dynamics import chunk_shapes, make_dynamics_rollout, roll_clip

    del detail  # reads a code, and there is none
    config, params = model.config, model.params["dynamics"]
    chunk, d = config.rollout.chunk, len(model.statistics.motion_mean)
    tables = make_dynamics_tables(scene, config=config.dynamics, body=config.body)
    shapes = chunk_shapes(chunk, len(scene.body.joints), model.vertices, d)
    example = shapes_of((params, *shapes))
    roll = programs.program("dynamics", make_dynamics_rollout(tables, template, config), example, facts)

    def run(motion: Motion, inputs: MotionInput, V_start: jax.Array) -> Iterator[tuple[int, jax.Array]]:
        frames = body_frames(motion, scene.body)
        pieces = roll_clip(roll, params, V_start, frames, inputs.x.M, chunk=chunk)
        yield from ((start, jnp.asarray(V)) for start, V in pieces)

    return run
