"""The local dynamics: the next frame from the last two, patch by patch (not in the paper).

The paper's encoder turns the whole motion into one code, which knows the dances that it has seen. Here a
convolution over patches of the UV map advances the cloth as a simulator does: inertia plus a learned
correction from what is near, with the same weights everywhere on the cloth (as in learned simulators on
meshes, Pfaff et al. 2021, HOOD, Grigorev et al. 2023). A vertex is held back by a tether to its nearest pin
(long-range attachments, Kim et al. 2012): no error can blow the cloth up.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import flax.linen as nn
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.config import DynamicsConfig
from garment_jax.dynamics.features import (
    BODY,
    CLOTH,
    Body,
    body_features,
    cloth_features,
    last_frames,
    reach_feature,
)
from garment_jax.dynamics.pose import BodyFrame, carried, last_body, posed
from garment_jax.dynamics.tables import DynamicsTables
from garment_jax.geometry.uv_maps import from_map

STEP = 0.02  # metres; what counts as 1 in the network's output
SLOPE = 0.1  # of its leaky ReLUs
FINE, COARSE, LAST = 3, 3, 2  # residual blocks on patches, on pairs of patches, on patches again


class DynamicsCarry(NamedTuple):
    """What the local dynamics carry from frame to frame."""

    V: Any  # [b, n, 3] metres, last frame, its own root frame
    V_before: Any  # [b, n, 3] metres, the frame before it, in the same root frame


def at_rest(V: Float[Array, "b n 3"]) -> DynamicsCarry:
    """Return the state of a garment that does not move."""
    return DynamicsCarry(V, V)


class _Block(nn.Module):
    """A residual block; its second layer begins small."""

    wraps: bool

    @nn.compact
    def __call__(self, x: jax.Array) -> jax.Array:
        width = x.shape[-1]
        y = nn.Dense(width)(neighbourhoods(x, self.wraps))
        y = nn.Dense(width, kernel_init=nn.initializers.variance_scaling(0.1, "fan_in", "normal"))(_leaky(y))
        return x + y


class PatchNetwork(nn.Module):
    """Features of patches `[b, gh, gw, c]` to features `[b, gh, gw, out]`: two levels and a mean over all."""

    channels: Sequence[int]
    out: int
    wraps: bool

    @nn.compact
    def __call__(self, x: jax.Array) -> jax.Array:
        fine, coarse = self.channels
        x = _leaky(nn.Dense(fine)(x))
        for _ in range(FINE):
            x = _Block(self.wraps)(x)
        h, w = x.shape[1:3]
        even = jnp.pad(x, ((0, 0), (0, h % 2), (0, w % 2), (0, 0)), mode="edge")
        y = _leaky(nn.Dense(coarse)(to_patches(even, 2)))
        for k in range(COARSE):
            y = _Block(self.wraps)(y)
            if k == 1:
                y = y + _leaky(nn.Dense(coarse)(y.mean(axis=(1, 2), keepdims=True)))
        x = x + from_patches(nn.Dense(4 * fine)(y), 2)[:, :h, :w]
        for _ in range(LAST):
            x = _Block(self.wraps)(x)
        small = nn.initializers.variance_scaling(4e-4, "fan_in", "normal")
        return nn.Dense(self.out, kernel_init=small)(x)


def _leaky(x: jax.Array) -> jax.Array:
    return nn.leaky_relu(x, SLOPE)


def neighbourhoods(x: Float[Array, "b k l c"], wraps: bool) -> Float[Array, "b k l d"]:
    """Return every patch's 3 x 3 neighbours side by side: a convolution is then one matrix product.

    As a convolution inside a loop its gradient takes fifty times as long on a CPU (XLA).
    """
    left, right = (x[:, :, -1:], x[:, :, :1]) if wraps else (x[:, :, :1], x[:, :, -1:])
    y = jnp.concatenate([left, x, right], axis=2)
    y = jnp.concatenate([y[:, :1], y, y[:, -1:]], axis=1)
    h, w = x.shape[1:3]
    return jnp.concatenate([y[:, i : i + h, j : j + w] for i in range(3) for j in range(3)], axis=-1)


def to_patches(x: Float[Array, "b h w c"], size: int) -> Float[Array, "b k l d"]:
    """Return the texels of each `size` x `size` patch side by side in the channels."""
    b, h, w, c = x.shape
    cells = x.reshape(b, h // size, size, w // size, size, c).transpose(0, 1, 3, 2, 4, 5)
    return cells.reshape(b, h // size, w // size, size * size * c)


def from_patches(x: Float[Array, "b k l d"], size: int) -> Float[Array, "b h w c"]:
    """Return the map of patches; the inverse of `to_patches`."""
    b, k, m, d = x.shape
    cells = x.reshape(b, k, m, size, size, d // size**2).transpose(0, 1, 3, 2, 4, 5)
    return cells.reshape(b, k * size, m * size, d // size**2)


def patch_network(tables: DynamicsTables, config: DynamicsConfig) -> PatchNetwork:
    """Return the network for the garment of `tables`."""
    return PatchNetwork(config.channels, 3 * config.patch**2, tables.wraps)


def init_dynamics(key: jax.Array, tables: DynamicsTables, *, config: DynamicsConfig) -> dict:
    """Return fresh parameters; the key is consumed."""
    h, w, p = config.rows, config.columns, config.patch
    width = CLOTH * p**2 + BODY * (p // 2) ** 2 + 1
    x = jnp.zeros((1, h // p, w // p, width))
    return jax.jit(patch_network(tables, config).init)(key, x)["params"]


def dynamics_step(
    params: dict,
    carry: DynamicsCarry,
    frame: BodyFrame,
    *,
    tables: DynamicsTables,
    config: DynamicsConfig,
) -> DynamicsCarry:
    """Return the state after one frame, `carry.V` metres in its root frame; `b` motions side by side.

    V = V_prev + (V_prev - V_prev_prev) + correction, then pins, then tethers.
    """
    frame, carry = jax.tree.map(jnp.asarray, (frame, carry))
    V_prev, V_before = carried(carry.V, frame), carried(carry.V_before, frame)
    x, moved = last_frames(V_prev, V_before, tables)
    body = Body(frame.A, last_body(frame))
    p = config.patch
    seen = to_patches(cloth_features(x, moved, body, tables), p)
    beside = to_patches(body_features(x, body, tables), p // 2)
    reach = jnp.broadcast_to(reach_feature(tables, p), (*seen.shape[:3], 1))
    features = jnp.concatenate([seen, beside, reach], axis=-1)
    out = jnp.asarray(patch_network(tables, config).apply({"params": params}, features))
    correction = STEP * jnp.einsum("hwij,bhwi->bhwj", tables.frames, from_patches(out, p))
    V = V_prev + from_map(moved + correction, tables.atlas)
    return DynamicsCarry(held(V, frame, tables), V_prev)


def held(V: Float[Array, "b n 3"], frame: BodyFrame, tables: DynamicsTables) -> Float[Array, "b n 3"]:
    """Return `V` with its pins where the body has them, none farther from its pin than the cloth is long."""
    if not len(tables.pins):
        return V
    pins = posed(frame.A, tables.held)
    V = V.at[:, tables.pins].set(pins)
    anchor = jnp.take(pins, tables.anchor, axis=1)
    away = V - anchor
    far = jnp.sqrt(jnp.square(away).sum(axis=-1, keepdims=True) + 1e-12)
    return anchor + away * jnp.minimum(1.0, jnp.asarray(tables.tether)[None, :, None] / far)
