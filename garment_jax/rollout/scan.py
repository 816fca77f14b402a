"""Rollouts: a `lax.scan` over frames, its own prediction fed back (paper 3.3)."""

from collections.abc import Callable

import jax
from jaxtyping import Array, Float

from garment_jax.config import Config
from garment_jax.data.template import Template
from garment_jax.motion.network import MotionCarry, motion_gates
from garment_jax.rollout.step import finish, motion_step
from garment_jax.structs import FrameInput


def rollout(
    params: dict,
    state: MotionCarry,
    x: FrameInput,
    *,
    template: Template,
    config: Config,
    detail: bool = True,
) -> tuple[MotionCarry, Float[Array, "t *b n 3"]]:
    """Return the state after `t` frames and every frame's garment, metres, root frames.

    Leaves of `x` are `[t, *b, ...]`. What does not depend on the carry runs for all frames at once: the
    motion's gates before the scan and, since it is not fed back, detail after it.
    """
    state, Z, V = latent_rollout(params, state, x, template=template, config=config)

    def finished(frame: tuple[jax.Array, jax.Array]) -> jax.Array:
        return finish(params, *frame, template=template, config=config, detail=detail)

    # frame by frame: as one batch the detail module's intermediates leave the cache, at three times the time
    return state, jax.lax.map(finished, (V, Z))


def latent_rollout(
    params: dict, state: MotionCarry, x: FrameInput, *, template: Template, config: Config
) -> tuple[MotionCarry, Float[Array, "t *b latent"], Float[Array, "t *b n 3"]]:
    """Return the state after the frames, their latent codes and their garments before detail."""
    gates = motion_gates(params["motion"], x.M, template=template)

    def frame(state: MotionCarry, inputs: tuple[FrameInput, jax.Array]):
        state, Z = motion_step(params, state, *inputs, template=template, config=config)
        return state, (Z, state.V_prev)

    state, (Z, V) = jax.lax.scan(frame, state, (x, gates))
    return state, Z, V


def make_rollout(
    template: Template, config: Config, *, detail: bool = True
) -> Callable[[dict, MotionCarry, FrameInput], tuple[MotionCarry, jax.Array]]:
    """Return `rollout` jitted for one garment; clips go through it in chunks of one length."""

    def run(params: dict, state: MotionCarry, x: FrameInput):
        return rollout(params, state, x, template=template, config=config, detail=detail)

    return jax.jit(run)
