"""The part of a garment that a solve may move, gathered into small arrays, and its smooth energy."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from garment_jax.collision.tables import CollisionTables
from garment_jax.geometry.marked import WORD, marked_up_to, pack_words, select


class Region(NamedTuple):
    """`m` vertices in the order of their groups, numbered locally; row m is everything that stays put."""

    vertex: jax.Array  # [m] int32 garment vertex
    own: jax.Array  # [m] bool, False for an unused slot
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
    """Return the region of the `touched` vertices `[n]`, which must be `size` (a multiple of 32) at most.

    It holds all one-rings of the moving vertices, so that its energy's gradient is the whole mesh's.
    """
    n = len(tables.index)
    order = jnp.asarray(tables.order)
    words = pack_words(jnp.pad(touched[order], (0, -n % WORD)).reshape(-1, 1, WORD))
    word, place, own = select(0, size, words, marked_up_to(words))
    vertex = order[jnp.minimum(word * WORD + place, n - 1)]
    local = jnp.full(n, size, jnp.int32)
    local = local.at[jnp.where(own, vertex, n)].set(jnp.arange(size, dtype=jnp.int32), mode="drop")
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
