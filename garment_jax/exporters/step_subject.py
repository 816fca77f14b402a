"""A model with its garment and a short motion: what is exported, and what the export is checked with."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from garment_jax.body.seeds import Seeds
from garment_jax.dataset.motion_input import MotionInput
from garment_jax.dataset.template import Template
from garment_jax.exporters.column_rnn_functions import corrected, flat, unflat
from garment_jax.io.sequence import open_sequence
from garment_jax.model.compose import RolloutState, init_state, step
from garment_jax.model.misfit import check_parameters
from garment_jax.model.motion.network import MotionCarry
from garment_jax.model.store import Model, model_input, skinned_template, template_for
from garment_jax.structs import FrameInput, Motion, Scene
from garment_jax.training.pipeline import trained_model


class StepSubject(NamedTuple):
    """What is exported."""

    model: Model
    scene: Scene
    template: Template
    seeds: Seeds
    motion: Motion  # first frames of the clip
    name: str  # of the run or model


def load_subject(run_or_model: str | Path, clip: str | Path, *, frames: int) -> StepSubject:
    """Return the model with the garment of `clip` and the first `frames` of its motion.

    Raises `FileNotFoundError`, `OSError` or `ValueError` for a folder that holds no model, or a clip that
    cannot be read or shows another garment.
    """
    model = trained_model(run_or_model)
    with open_sequence(clip) as sequence:
        scene, motion = sequence.scene, sequence.motion
    template, seeds = template_for(model, scene, str(clip))
    check_parameters(model, template)
    few = Motion(motion.rotations[:frames], motion.root[:frames], model.fps)
    return StepSubject(model, scene, template, seeds, few, Path(run_or_model).resolve().name)


def step_function(subject: StepSubject, detail: bool) -> Callable[..., tuple]:
    """Return (h, V_prev, *fields of the frame) -> (V, h, V_prev of the next step), parameters inside.

    The latents' alone: the column RNN is a graph of its own (`column_rnn_function`).
    """
    names = frame_fields(subject)
    features = np.zeros(len(subject.template.statistics.motion_mean), np.float32)
    still = FrameInput(features, np.eye(3, dtype=np.float32), np.zeros(3, np.float32))

    def run(h: jax.Array, V_prev: jax.Array, *fields: jax.Array):
        state, V = step(
            subject.model.params,
            RolloutState(MotionCarry(h, V_prev)),
            still._replace(**dict(zip(names, fields, strict=True))),
            template=subject.template,
            config=subject.model.config,
            detail=detail,
        )
        return V, *state.motion

    return run


def column_rnn_function(subject: StepSubject) -> Callable[..., tuple]:
    """Return (V, state, rotations, root, both of the last frame) -> (V, state), parameters inside."""
    model, ring = subject.model, subject.template.ring
    assert ring is not None

    def run(V: jax.Array, column_rnn: jax.Array, *skeletons: jax.Array):
        state = unflat(column_rnn, ring, model.config.column_rnn)
        V, state = corrected(
            model.params["column_rnn"], subject.scene, ring, model.config, V, state, *skeletons
        )
        return V, flat(state)

    return run


def frame_fields(subject: StepSubject) -> tuple[str, ...]:
    """Return which fields of `FrameInput` the step takes, in its order.

    A model in canonical pose does not carry its last frame over, but poses the new one.
    """
    return ("M", "turn", "shift") if subject.template.W is None else ("M", "R", "t")


def first_state(subject: StepSubject) -> tuple[MotionInput, RolloutState]:
    """Return the motion's inputs and the state before its first frame, as `rollout.animate` begins."""
    model, scene, template, seeds = subject.model, subject.scene, subject.template, subject.seeds
    inputs = model_input(model, scene, template, seeds, subject.motion)
    start = skinned_template(model, template, seeds, inputs)
    return inputs, init_state(model.params, start, template=template, config=model.config)
