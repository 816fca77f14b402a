"""One frame in, one frame out (paper 3.3 and 3.4): the causal pair `init_state` and `step`."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.config import Config
from garment_jax.data.template import Template
from garment_jax.generative.canonical import posed
from garment_jax.generative.network import decode
from garment_jax.motion.network import MotionCarry, held_back, last_frame, motion_code, motion_gates
from garment_jax.structs import FrameInput


def init_state(params: dict, V_start: Float[Array, "*b n 3"], *, config: Config) -> MotionCarry:
    """Return the state before the first frame, from the garment that hangs there.

    `V_start` (metres, root frame of the first frame) is the skinned template (`skinned_template`) or a
    frame that the user gives, which a model in canonical pose wants unposed (`generative.canonical`).
    `params` is not read; it keeps the pair's signatures alike.
    """
    del params
    return MotionCarry(jnp.zeros((*V_start.shape[:-2], config.motion.gru), V_start.dtype), V_start)


def motion_step(
    params: dict,
    state: MotionCarry,
    x: FrameInput,
    gates: Float[Array, "*b g"],
    *,
    template: Template,
    config: Config,
) -> tuple[MotionCarry, Float[Array, "*b latent"]]:
    """Return the next state and its latent code; `gates` are `motion_gates` of `x.M`.

    The state holds the frame before detail and before collision: what is fed back in training.
    """
    h, Z = motion_code(
        params["motion"],
        state.h,
        last_frame(state.V_prev, held_back(x, template), template),
        gates,
        template=template,
        config=config.motion,
        generative=config.generative,
    )
    V = decode(params["generative"], Z, template=template, config=config.generative).V
    return MotionCarry(h, V), Z


def step(
    params: dict,
    state: MotionCarry,
    x: FrameInput,
    *,
    template: Template,
    config: Config,
    detail: bool = True,
) -> tuple[MotionCarry, Float[Array, "*b n 3"]]:
    """Return the next state and the garment of this frame, metres, root frame; nothing from the future.

    `params` holds "generative", "motion" and, unless `detail` is off, "detail". Leading axes `*b` of
    `state` and `x` are motions side by side.
    """
    gates = motion_gates(params["motion"], x.M, template=template)
    state, Z = motion_step(params, state, x, gates, template=template, config=config)
    return state, finish(params, state.V_prev, Z, x, template=template, config=config, detail=detail)


def finish(
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
        from garment_jax.detail.network import enhance  # a part that is off is not even imported

        V = enhance(params["detail"], V, Z, template=template, config=config.detail)
    return posed(V, x, template=template)
