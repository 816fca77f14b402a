"""Rollouts: a `lax.scan` over frames, its own prediction fed back (paper 3.3)."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.config import Config
from garment_jax.dataset.template import Template
from garment_jax.model.compose import RolloutState, detail_and_pose, motion_step
from garment_jax.model.generative.network import decode
from garment_jax.model.motion.network import MotionCarry, code_of, gru_step, motion_gates
from garment_jax.structs import FrameInput

BLOCK = 16  # frames decoded side by side where none needs the one before it


def rollout(
    params: dict,
    state: RolloutState,
    x: FrameInput,
    *,
    template: Template,
    config: Config,
    detail: bool = True,
) -> tuple[RolloutState, Float[Array, "t *b n 3"]]:
    """Return the state after `t` frames and every frame's garment, metres, root frames.

    Leaves of `x` are `[t, *b, ...]`. What does not depend on the carry runs for all frames at once: the
    motion's gates before the scan and, since it is not fed back, detail after it. A column RNN that `state`
    has is rolled out beside the latents, which never see it, and corrects their frames. Raises as `step`.
    """
    motion, Z, V = latent_rollout(params, state.motion, x, template=template, config=config)

    def finished(frame: tuple[jax.Array, jax.Array, FrameInput]) -> jax.Array:
        return detail_and_pose(params, *frame, template=template, config=config, detail=detail)

    # frame by frame: as one batch the detail module's intermediates leave the cache, at three times the time
    V = jax.lax.map(finished, (V, Z, x))
    if state.column_rnn is None:
        return RolloutState(motion), V
    from garment_jax.model.column_rnn.rollout import column_frames_of

    column_rnn, V = column_frames_of(params, state.column_rnn, x, V, template=template, config=config)
    return RolloutState(motion, column_rnn), V


def latent_rollout(
    params: dict, state: MotionCarry, x: FrameInput, *, template: Template, config: Config
) -> tuple[MotionCarry, Float[Array, "t *b latent"], Float[Array, "t *b n 3"]]:
    """Return the latents' state after the frames, the latents and garments before detail, networks' frame."""
    gates = motion_gates(params["motion"], jnp.asarray(x.M), template=template)
    if not config.motion.previous_state:
        return _memoryless_rollout(params, state, gates, template=template, config=config)

    def frame(state: MotionCarry, inputs: tuple[FrameInput, jax.Array]):
        state, Z = motion_step(params, state, *inputs, template=template, config=config)
        return state, (Z, state.V_prev)

    state, (Z, V) = jax.lax.scan(frame, state, (x, gates))
    return state, Z, V


def _memoryless_rollout(
    params: dict, state: MotionCarry, gates: jax.Array, *, template: Template, config: Config
) -> tuple[MotionCarry, jax.Array, jax.Array]:
    """Return `latent_rollout` of a model that does not read its last frame: only the GRU is sequential."""

    def frame(h: jax.Array, gates: jax.Array):
        h = gru_step(params["motion"], h, gates)
        return h, h

    h, states = jax.lax.scan(frame, state.h, gates)
    Z = code_of(params["motion"], states)

    def decoded(Z: jax.Array) -> jax.Array:
        return decode(params["generative"], Z, template=template, config=config.generative).V

    V = in_blocks(decoded, Z, BLOCK)
    return MotionCarry(h, V[-1]), Z, V


def in_blocks(f: Callable[[jax.Array], jax.Array], x: jax.Array, size: int) -> jax.Array:
    """Return `f` of all rows of `x` `[t, ...]`, `size` rows at a time: as fast as at once, in less memory."""
    t = len(x)
    if t <= size:
        return f(x)
    rows = x[: t - t % size].reshape(t // size, size, *x.shape[1:])
    y = jax.lax.map(f, rows)
    y = y.reshape(-1, *y.shape[2:])
    return jnp.concatenate([y, f(x[t - t % size :])]) if t % size else y


def make_rollout(
    template: Template, config: Config, *, detail: bool = True
) -> Callable[[dict, RolloutState, FrameInput], tuple[RolloutState, jax.Array]]:
    """Return `rollout` jitted for one garment; clips go through it in chunks of one length."""

    def run(params: dict, state: RolloutState, x: FrameInput):
        return rollout(params, state, x, template=template, config=config, detail=detail)

    return jax.jit(run)
