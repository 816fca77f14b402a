"""One frame in, one frame out (paper 3.3 and 3.4): the causal pair `init_state` and `step`."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.config import Config
from garment_jax.dataset.template import Template
from garment_jax.model.generative.canonical import posed
from garment_jax.model.generative.network import decode
from garment_jax.model.motion.network import MotionCarry, clamped, last_frame, motion_code, motion_gates
from garment_jax.structs import ColumnCarry, FrameInput


class RolloutState(NamedTuple):
    """What a rollout carries from frame to frame."""

    motion: MotionCarry
    column_rnn: ColumnCarry | None = None  # of the column RNN's ring; None: latents alone


def init_state(
    params: dict, V_start: Float[Array, "*b n 3"], *, template: Template, config: Config
) -> RolloutState:
    """Return the state before the first frame, from the garment that hangs there.

    `V_start` (metres, root frame of the first frame) is the skinned template (`skinned_template`) or a
    frame that the user gives, which a model in canonical pose wants unposed (`generative.canonical`).
    The column RNN, where `params` and `template` (`template_for`) have one, begins from the template at rest.
    """
    lanes = V_start.shape[:-2]
    motion = MotionCarry(jnp.zeros((*lanes, config.motion.gru), V_start.dtype), V_start)
    if template.ring is None or "column_rnn" not in params:
        return RolloutState(motion)
    from garment_jax.model.column_rnn.network import at_rest  # a part that is off is not even imported

    return RolloutState(motion, at_rest(template.ring, lanes, config=config.column_rnn))


def motion_step(
    params: dict,
    state: MotionCarry,
    x: FrameInput,
    gates: Float[Array, "*b g"],
    *,
    template: Template,
    config: Config,
) -> tuple[MotionCarry, Float[Array, "*b latent"]]:
    """Return the latents' next state and latent code; `gates` are `motion_gates` of `x.M`.

    The state holds the frame before detail and before collision: what is fed back in training.
    """
    h, Z = motion_code(
        params["motion"],
        state.h,
        last_frame(state.V_prev, clamped(x, template), template),
        gates,
        template=template,
        config=config.motion,
        generative=config.generative,
    )
    V = decode(params["generative"], Z, template=template, config=config.generative).V
    return MotionCarry(h, V), Z


def step(
    params: dict,
    state: RolloutState,
    x: FrameInput,
    *,
    template: Template,
    config: Config,
    detail: bool = True,
) -> tuple[RolloutState, Float[Array, "*b n 3"]]:
    """Return the next state and the garment of this frame, metres, root frame; nothing from the future.

    `params` holds "generative", "motion" and, unless `detail` is off, "detail"; where `state` has a column
    RNN, "column_rnn" too, and `x` is from `model_input` (`ValueError` if not). Leading axes `*b` of `state`
    and `x` are motions side by side.
    """
    gates = motion_gates(params["motion"], jnp.asarray(x.M), template=template)
    motion, Z = motion_step(params, state.motion, x, gates, template=template, config=config)
    V = detail_and_pose(params, motion.V_prev, Z, x, template=template, config=config, detail=detail)
    if state.column_rnn is None:
        return RolloutState(motion), V
    from garment_jax.model.column_rnn.rollout import column_frame

    column_rnn, V = column_frame(params, state.column_rnn, x, V, template=template, config=config)
    return RolloutState(motion, column_rnn), V


def detail_and_pose(
    params: dict,
    V: jax.Array,
    Z: jax.Array,
    x: FrameInput,
    *,
    template: Template,
    config: Config,
    detail: bool = True,
) -> jax.Array:
    """Return V_f in root frames: the decoded garment with its detail offset, if wanted and trained."""
    if detail and "detail" in params:
        from garment_jax.model.detail.network import enhance  # a part that is off is not even imported

        V = enhance(params["detail"], V, Z, template=template, config=config.detail)
    return posed(V, x, template=template)
