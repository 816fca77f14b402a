"""The part of a garment that a solve may move, gathered into small arrays, and its smooth energy."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from garment_jax.collision.tables import CollisionTables


class Region(NamedTuple):
    """`m` vertices in groups of 8, numbered locally; row m stands for everything that stays put."""

    vertex: jax.Array  # [m] int32 garment vertex
    own: jax.Array  # [m] bool, False for a repeated or unused slot
    moving: jax.Array  # [m] bool
    index: jax.Array  # [m, k] int32 local one-ring
    weight: jax.Array  # [m, k]
    weight_back: jax.Array  # [m, k]
    total: jax.Array  # [m] sum of a row of weight: 1, or 0 for a lone vertex or an unused slot


def dilate(mask: Bool[Array, " n"], tables: CollisionTables, rings: int | Array) -> Bool[Array, " n"]:
    """Return the vertices within `rings` edges of the marked ones."""
    index = jnp.asarray(tables.index)
    return jax.lax.fori_loop(0, rings, lambda _, m: m | m[index].any(axis=1), mask)


def make_region(touched: Array, moving: Array, tables: CollisionTables, size: int) -> Region:
    """Return the region of the `touched` groups `[g]`, which must be `size` at most.

    It holds all one-rings of the moving vertices, so that its energy's gradient is the whole mesh's.
    """
    chosen = jnp.nonzero(touched, size=size, fill_value=len(touched))[0]
    used = chosen < len(touched)
    chosen = jnp.minimum(chosen, len(touched) - 1)
    vertex = jnp.asarray(tables.groups)[chosen].reshape(-1)
    own = (jnp.asarray(tables.own)[chosen] & used[:, None]).reshape(-1)
    m, n = len(vertex), len(tables.index)
    local = jnp.full(n, m, jnp.int32)
    local = local.at[jnp.where(own, vertex, n)].set(jnp.arange(m, dtype=jnp.int32), mode="drop")
    weight, back = (
        jnp.where(own[:, None], jnp.asarray(w)[vertex], 0.0) for w in (tables.weight, tables.weight_back)
    )
    index = local[jnp.asarray(tables.index)[vertex]]
    return Region(vertex, own, own & moving[vertex], index, weight, back, weight.sum(axis=1))


def smoothness(x: Float[Array, "m 3"], region: Region) -> Float[Array, ""]:
    """Return 1/2 ||Lap x||^2 for a displacement `x` (metres; zero outside the region)."""
    r = stretch(x, region.index, region.weight, region.weight_back, region.total)
    return 0.5 * (r * r).sum()


@jax.custom_vjp
def stretch(x, index, weight, weight_back, total) -> Array:
    """Return the Laplacian `[m, 3]` of `x`; its gradient is a gather with the transposed weights.

    Differentiated by itself the gather would become a scatter, several times slower on a CPU.
    """
    return _apply(x, index, weight, total)


def _apply(x, index, weight, total):
    padded = jnp.concatenate([x, jnp.zeros((1, 3), x.dtype)])
    return (padded[index] * weight[..., None]).sum(axis=1) - total[:, None] * x


def _forward(x, index, weight, weight_back, total):
    return _apply(x, index, weight, total), (index, weight_back, total)


def _backward(saved, r):
    index, weight_back, total = saved
    return _apply(r, index, weight_back, total), None, None, None, None


stretch.defvjp(_forward, _backward)
