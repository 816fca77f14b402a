"""Animate a garment: one frame, a scan over frames, chunks streamed to disk, whole models on disk."""

from garment_jax.animation.animate import animate, animate_file, make_animator
from garment_jax.animation.clips import rollout_batch, rollout_chunks, rollout_many, stack_motions
from garment_jax.animation.plan import ScenePlan, make_plan
from garment_jax.model.compose import RolloutState, init_state, motion_step, step
from garment_jax.model.scan import make_rollout, rollout
from garment_jax.model.store import (
    Model,
    load_model,
    model_input,
    save_model,
    skinned_template,
    template_for,
    without_column_rnn,
)

__all__ = [
    "Model",
    "RolloutState",
    "ScenePlan",
    "animate",
    "animate_file",
    "init_state",
    "load_model",
    "make_animator",
    "make_plan",
    "make_rollout",
    "model_input",
    "motion_step",
    "rollout",
    "rollout_batch",
    "rollout_chunks",
    "rollout_many",
    "save_model",
    "skinned_template",
    "stack_motions",
    "step",
    "template_for",
    "without_column_rnn",
]
