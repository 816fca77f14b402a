"""A motion through the networks, chunk by chunk: the codes (the paper's), corrected by the swing."""

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

    A model without a swing (`without_swing`) does not even import it.
    """
    chunk, d = model.config.rollout.chunk, len(model.statistics.motion_mean)
    codes = {name: part for name, part in model.params.items() if name != "swing"}
    state = init_state(codes, jnp.zeros((model.vertices, 3)), config=model.config)
    j = len(scene.body.joints)
    shapes = FrameInput((d,), (3, 3), (3,), (j, 3, 3), (j, 3))
    frames = FrameInput(*(np.zeros((chunk, *shape), np.float32) for shape in shapes))
    rolled = make_rollout(template, model.config, detail=detail)
    example = shapes_of((codes, state, frames))
    roll = programs.program("rollout", rolled, example, {**facts, "detail": detail})
    correct = None
    if "swing" in model.params and model.config.rollout.swing:
        from garment_jax.rollout.swing import make_swing_corrector

        correct = make_swing_corrector(
            model.params["swing"],
            scene,
            config=model.config.swing,
            weight=model.config.rollout.swing,
            gain=model.config.rollout.gain,
            chunk=chunk,
            programs=programs,
            facts=facts,
        )

    def run(motion: Motion, inputs: MotionInput, V_start: jax.Array) -> Iterator[tuple[int, jax.Array]]:
        x, _ = stack_motions([inputs.x], chunk)
        single = jax.tree.map(lambda leaf: leaf[:, 0], x)
        state = init_state(codes, V_start, config=model.config)
        pieces = rollout_chunks(roll, codes, state, single, chunk=chunk)
        yield from pieces if correct is None else correct(motion, pieces)

    return run
