"""What a patch of cloth sees: its own shape and motion, and the body beside it (all causal)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.dynamics.pose import posed, turned
from garment_jax.dynamics.tables import DynamicsTables
from garment_jax.geometry.uv_maps import to_map

# what counts as 1 in each feature, metres (a frame, for movements)
OFFSET, MOVED, PLACE, DEEP, NEAR = 0.1, 0.03, 0.3, 0.05, 0.1
FASTEST = 0.2  # metres a frame that cloth is taken to keep of its movement: 6 m/s at 30 fps
CLOTH, BODY = 20, 8  # features a texel of `cloth_features` and of `body_features`


class Body(NamedTuple):
    """The joints' transforms `[b, j, 3, 4]` in this frame's root frame."""

    A: jax.Array
    A_before: jax.Array  # one frame ago


def local(v: jax.Array, tables: DynamicsTables) -> jax.Array:
    """Return vectors `[b, h, w, 3]` of the root frame in the texels' own frames."""
    return jnp.einsum("hwij,bhwj->bhwi", tables.frames, v)


def cloth_features(
    x: Float[Array, "b h w 3"],
    moved: Float[Array, "b h w 3"],
    body: Body,
    tables: DynamicsTables,
) -> Float[Array, "b h w c"]:
    """Return place, movement, direction and length of the cloth's edges, beside the skinned template's."""
    b, shape = len(x), tables.reach.shape
    S, S_before = (posed(A, tables.cloth).reshape(b, *shape, 3) for A in body)
    du, dv = edges(x, tables.wraps)
    rest = jnp.asarray(tables.rest)[None]
    lengths = jnp.stack([_length(du), _length(dv)], axis=-1) / rest
    place = local(x, tables)
    parts = [
        (place - local(S, tables)) / OFFSET,
        local(moved, tables) / MOVED,
        local(S - S_before, tables) / MOVED,
        place / PLACE,
        local(du, tables) / rest[..., :1],
        local(dv, tables) / rest[..., 1:],
        jnp.clip(10.0 * (lengths - 1.0), -3.0, 3.0),
    ]
    return jnp.concatenate(parts, axis=-1)


def edges(x: jax.Array, wraps: bool) -> tuple[jax.Array, jax.Array]:
    """Return the differences to the next texel in u and in v, `[b, h, w, 3]` each."""
    du = jnp.roll(x, -1, axis=2) - x
    if not wraps:
        du = jnp.concatenate([du[:, :, :-1], du[:, :, -2:-1]], axis=2)
    dv = x[:, 1:] - x[:, :-1]
    return du, jnp.concatenate([dv, dv[:, -1:]], axis=1)


def _length(v: jax.Array) -> jax.Array:
    return jnp.sqrt(jnp.square(v).sum(axis=-1) + 1e-10)  # safe at zero


def body_features(x: Float[Array, "b h w 3"], body: Body, tables: DynamicsTables) -> Float[Array, "b k l c"]:
    """Return the nearest body point's distance, normal and movement, for every second texel each way."""
    at = (slice(None), slice(1, None, 2), slice(1, None, 2))
    q = x[at]
    frames = tables.frames[1::2, 1::2].reshape(-1, 3, 3)
    flat = q.reshape(len(x), -1, 3)
    p, p_before = (posed(A, tables.near) for A in body)
    normal = turned(body.A, tables.near, tables.normals)
    square = jnp.square(p).sum(axis=-1)[:, None] - 2.0 * jnp.einsum("bqi,bki->bqk", flat, p)
    nearest = jnp.argmin(jax.lax.stop_gradient(square), axis=-1)[..., None]
    b, n, moved = (jnp.take_along_axis(y, nearest, axis=1) for y in (p, normal, p - p_before))
    away = flat - b
    ds = (away * n).sum(axis=-1, keepdims=True)
    close = jnp.exp(-_length(away)[..., None] / NEAR)
    n, moved = (jnp.einsum("qij,bqj->bqi", frames, y) for y in (n, moved))
    parts = [jnp.clip(ds / DEEP, -2.0, 3.0), close, n * close, moved / MOVED * close]
    return jnp.concatenate(parts, axis=-1).reshape(*q.shape[:3], BODY)


def last_frames(
    V: Float[Array, "b n 3"], V_before: Float[Array, "b n 3"], tables: DynamicsTables
) -> tuple[Float[Array, "b h w 3"], Float[Array, "b h w 3"]]:
    """Return the map of the last frame, and its movement since the one before, no faster than `FASTEST`."""
    both = to_map(jnp.concatenate([V, V - V_before], axis=-1), tables.atlas)
    x, moved = both[..., :3], both[..., 3:]
    return x, moved * jnp.minimum(1.0, FASTEST / _length(moved)[..., None])


def reach_feature(tables: DynamicsTables, patch: int) -> np.ndarray:
    """Return how far a patch is from the pins, `[gh, gw, 1]`, in units of half a metre."""
    h, w = tables.reach.shape
    cells = tables.reach.reshape(h // patch, patch, w // patch, patch)
    return (2.0 * cells.mean(axis=(1, 3)))[..., None].astype(np.float32)
