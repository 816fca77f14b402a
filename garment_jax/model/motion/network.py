"""The dynamic motion encoder behind pure functions (paper 3.3): Z = fc(E_m(M) | E_s(S_prev)).

E_m is a dense layer and a GRU; its part before the recurrence does not depend on the carry, so a
rollout computes it for all frames of a chunk at once (`motion_gates`).
"""

from typing import NamedTuple

import flax.linen as nn
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.body.motion_features import root_velocity_at
from garment_jax.config import GenerativeConfig, MotionConfig
from garment_jax.dataset.template import Template
from garment_jax.model.generative.blocks import MapEncoder, along_channels, leaky
from garment_jax.model.generative.network import POOLED, position_map
from garment_jax.structs import FrameInput

BEYOND = 0.1  # of a feature's training range: motion farther outside counts as this far outside


class MotionCarry(NamedTuple):
    """What a rollout carries from frame to frame."""

    h: jax.Array  # [*b, gru] state of E_m
    V_prev: jax.Array  # [*b, n, 3] last predicted frame before detail and collision, networks' frame


def state_encoder(config: MotionConfig, generative: GenerativeConfig, size: int) -> MapEncoder:
    """Return E_s: as E_gen, with a hidden layer in its pooled path (the state's effect is not linear)."""
    skip = min(POOLED, size) if generative.linear_skip else 0
    return MapEncoder(
        config.channels,
        config.state_dim,
        generative.instance_norm,
        generative.map_statistics,
        skip=skip,
        skip_hidden=config.state_hidden,
        dense_scale=0.1 if skip else 1.0,
    )


def init_motion(
    key: jax.Array, template: Template, *, config: MotionConfig, generative: GenerativeConfig
) -> dict:
    """Return fresh parameters, a dict by network; the key is consumed."""
    size, d = template.atlas.coverage.shape[0], len(template.statistics.motion_mean)
    keys = jax.random.split(key, 5)
    joined = config.gru + (config.state_dim if config.previous_state else 0)
    params = {
        "dense": nn.Dense(config.dense).init(keys[0], jnp.zeros(d))["params"],
        "gru_x": nn.Dense(3 * config.gru).init(keys[1], jnp.zeros(config.dense))["params"],
        "gru_h": nn.Dense(3 * config.gru).init(keys[2], jnp.zeros(config.gru))["params"],
        "fc": nn.Dense(generative.latent_dim).init(keys[3], jnp.zeros(joined))["params"],
    }
    if config.previous_state:
        encoder = state_encoder(config, generative, size)
        params["E_s"] = jax.jit(encoder.init)(keys[4], jnp.zeros((size, size, 3)))["params"]
    return params


def _dense(params: dict, x: jax.Array) -> jax.Array:
    return x @ params["kernel"] + along_channels(params["bias"], x)


def normalise_motion(M: Float[Array, "*t d"], template: Template) -> Float[Array, "*t d"]:
    """Return the motion features in deviations from the training set's mean, held near its range.

    Nothing was learnt beyond the range, and what is far beyond it throws the cloth away for many frames:
    a feature counts as far outside as `BEYOND` at most. One that was constant in training stays within 10
    deviations all the same: a floor's 1e-3 would blow it up.
    """
    s = template.statistics
    spare = BEYOND * (s.motion_high - s.motion_low)
    low, high, mean, std = (
        jnp.broadcast_to(x, M.shape)
        for x in (s.motion_low - spare, s.motion_high + spare, s.motion_mean, s.motion_std)
    )
    return jnp.clip((jnp.clip(M, low, high) - mean) / std, -10.0, 10.0)


def motion_gates(params: dict, M: Float[Array, "*t d"], *, template: Template) -> Float[Array, "*t g"]:
    """Return the GRU's input gates for motion features `M`, any leading axes (E_m before the carry)."""
    return gates_of(params, normalise_motion(M, template))


def gates_of(params: dict, x: Float[Array, "*t d"]) -> Float[Array, "*t g"]:
    """Return the GRU's input gates for normalised motion `x`."""
    return _dense(params["gru_x"], leaky(_dense(params["dense"], x)))


def gru_step(params: dict, h: Float[Array, "*b k"], gates: Float[Array, "*b g"]) -> Float[Array, "*b k"]:
    """Return the next state of a GRU with PyTorch's `GRUCell` equations (reset, update, new; both biases)."""
    rx, ux, cx = jnp.split(gates, 3, axis=-1)
    rh, uh, ch = jnp.split(_dense(params["gru_h"], h), 3, axis=-1)
    update = jax.nn.sigmoid(ux + uh)
    new = jnp.tanh(cx + jax.nn.sigmoid(rx + rh) * ch)
    return (1.0 - update) * new + update * h


def carry_over(V_prev: Float[Array, "*b n 3"], x: FrameInput) -> Float[Array, "*b n 3"]:
    """Re-express the last frame in this frame's root frame: the cloth hung while the body moved."""
    return V_prev @ x.turn + x.shift[..., None, :]


def last_frame(V_prev: Float[Array, "*b n 3"], x: FrameInput, template: Template) -> Float[Array, "*b n 3"]:
    """Return the last frame as E_s reads it: carried over into this root frame, or unposed as it was."""
    return carry_over(V_prev, x) if template.W is None else V_prev


def code_of(params: dict, h: Float[Array, "*b k"]) -> Float[Array, "*b latent"]:
    """Return the latent code Z of GRU states `h` where the last frame is not read (the ablation)."""
    return _dense(params["fc"], h)


def clamped(x: FrameInput, template: Template) -> FrameInput:
    """Clamp the root's displacement and yaw rate to the training range plus `BEYOND`.

    Not in the paper. The previous garment is carried into the new root frame (E_s reads it there): a root
    that jumps 5 m would leave it 5 m behind, far outside the training data. Beyond the clamp the garment
    moves along with the root. The limit is the larger magnitude of both signs. A frame inside the range
    comes back bitwise. M has the layout of `body/motion_features`; a turn of exactly 180° has no sign and is
    dropped.
    """
    s, d = template.statistics, x.M.shape[-1]
    at = root_velocity_at(d)
    spare = BEYOND * (s.motion_high - s.motion_low)
    most = jnp.maximum(jnp.abs(s.motion_low), jnp.abs(s.motion_high)) + spare
    speed = jnp.abs(x.M[..., at : at + 4])
    limit = jnp.broadcast_to(most[at : at + 4], speed.shape)
    part = jnp.where(speed > limit, limit / jnp.where(speed > limit, speed, 1.0), 1.0)
    c, sine = x.turn[..., 0, 0], x.turn[..., 0, 2]
    kept = part[..., 3]
    angle = 2.0 * kept * jnp.arctan(sine / jnp.maximum(1.0 + c, 1e-6))
    c, sine = jnp.cos(angle), jnp.sin(angle)
    o, i = jnp.zeros_like(c), jnp.ones_like(c)
    turn = jnp.stack([c, o, sine, o, i, o, -sine, o, c], axis=-1).reshape(x.turn.shape)
    turn = jnp.where((kept < 1.0)[..., None, None], turn, x.turn)
    return x._replace(turn=turn, shift=x.shift * part[..., :3])


def motion_code(
    params: dict,
    h: Float[Array, "*b k"],
    V_prev: Float[Array, "*b n 3"],
    gates: Float[Array, "*b g"],
    *,
    template: Template,
    config: MotionConfig,
    generative: GenerativeConfig,
) -> tuple[Float[Array, "*b k"], Float[Array, "*b latent"]]:
    """Return the next GRU state and the latent code Z of one frame.

    `V_prev` is as `last_frame` gives it; it is not read at all when
    `config.previous_state` is off.
    """
    h = gru_step(params, h, gates)
    if not config.previous_state:
        return h, code_of(params, h)
    encoder = state_encoder(config, generative, template.atlas.coverage.shape[0])
    e = encoder.apply({"params": params["E_s"]}, position_map(V_prev, template))
    return h, _dense(params["fc"], jnp.concatenate([h, jnp.asarray(e)], axis=-1))
