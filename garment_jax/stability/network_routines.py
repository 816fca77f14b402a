"""The recurrent parts for the precision table: the GRU alone, and a trained model's rollout."""

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.dataset.motion_input import motion_input
from garment_jax.model.compose import init_state
from garment_jax.model.motion.network import gru_step
from garment_jax.model.scan import latent_rollout
from garment_jax.model.store import Model, skinned_template, template_for
from garment_jax.stability.routine import Routine, typed
from garment_jax.stability.subject import Subject
from garment_jax.structs import FrameInput

GRU = 500  # width of the recurrent state


def gru_routine(frames: int) -> Routine:
    """Return the GRU's state after `frames` steps of a smooth motion, random weights of the usual size."""
    rng = np.random.default_rng(3)
    kernel = rng.normal(size=(GRU, 3 * GRU)) / np.sqrt(GRU)
    bias = 0.1 * rng.normal(size=3 * GRU)
    waves = np.sin(np.arange(frames)[:, None] * rng.uniform(0.02, 0.3, 16) + rng.uniform(0, 6, 16))
    gates = waves @ rng.normal(size=(16, 3 * GRU)) / 4

    def f(kernel: jax.Array, bias: jax.Array, gates: jax.Array) -> jax.Array:
        params = {"gru_h": {"kernel": kernel, "bias": bias}}

        def step(h: jax.Array, gate: jax.Array) -> tuple[jax.Array, None]:
            return gru_step(params, h, gate), None

        return jax.lax.scan(step, jnp.zeros(GRU, gates.dtype), gates)[0]

    return Routine("GRU, frames", frames, f, (kernel, bias, gates), 1.0, "", 1e-4)


def rollout_routine(model: Model, subject: Subject, frames: int) -> Routine:
    """Return the garment after `frames` frames of the subject's first motion, before detail."""
    template, seeds = template_for(model, subject.scene, subject.name)
    config = model.config
    inputs = motion_input(
        subject.motions[0][1], subject.scene, seeds, config.body.motion_joints, seed_frames=1
    )
    x = jax.tree.map(lambda leaf: np.asarray(leaf[:frames], np.float64), inputs.x)
    start = np.asarray(skinned_template(model, template, seeds, inputs), np.float64)
    params = jax.tree.map(
        lambda leaf: np.asarray(leaf, np.float64), {k: model.params[k] for k in ("generative", "motion")}
    )

    def f(params: dict, start: jax.Array, x: FrameInput) -> jax.Array:
        tables = typed(template, start)
        state = init_state(params, start, template=tables, config=config).motion
        return latent_rollout(params, state, x, template=tables, config=config)[2][-1]

    return Routine("rollout, frames", frames, f, (params, start, x), 1e3, "mm", 1.0)
