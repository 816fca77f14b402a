"""The part of a garment that a solve may move, gathered into small arrays, and its smooth energy."""

import math
from functools import reduce
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from garment_jax.geometry.bitset import WORD, marked_up_to, pack_words, select
from garment_jax.geometry.noinline import fusion_barrier, noinline
from garment_jax.postprocess.collision.tables import CollisionTables

UNROLLED = 16  # neighbours up to which a sum over them is written out, at half the time of a reduction


class Members(NamedTuple):
    """Which vertices take part in a solve, before anything is gathered; `whole` is n + 1 in full words."""

    moving: jax.Array  # [n] bool
    vertex: jax.Array  # [whole] int32 those that move and their one-rings, group after group
    local: jax.Array  # [n] int32 place in `vertex`, `whole` for all others
    count: jax.Array  # [] int32


class Region(NamedTuple):
    """`m` vertices in the order of their groups, numbered locally; the last is what stays put."""

    vertex: jax.Array  # [m] int32 garment vertex
    own: jax.Array  # [m] bool, False for an unused slot
    moving: jax.Array  # [m] bool
    index: jax.Array  # [k, m] int32 local one-ring
    weight: jax.Array  # [k, m]
    weight_back: jax.Array  # [k, m]
    total: jax.Array  # [m] sum of a vertex' weights: 1, or 0 for a lone vertex or an unused slot


@noinline
def dilate(mask: Bool[Array, " n"], tables: CollisionTables, rings: int | Array) -> Bool[Array, " n"]:
    """Return the vertices within `rings` edges of the marked ones."""
    index = jnp.asarray(tables.index.T)  # of constants XLA would do it anew in every ring

    def ring(
        _: int | Array, marks: Array
    ) -> Array:  # integers: a CPU gathers eight of them at a time, but no bits
        if len(index) > UNROLLED:
            return marks | marks[index].max(axis=0)
        around = (marks.at[row].get(mode="promise_in_bounds") for row in index)
        return reduce(jnp.bitwise_or, around, marks)

    return jax.lax.fori_loop(0, rings, ring, mask.astype(jnp.int32)) > 0


def whole_size(tables: CollisionTables) -> int:
    """Return the slots of a region that holds the whole garment and what stays put."""
    n = len(tables.index) + 1
    return n + -n % WORD


def region_sizes(tables: CollisionTables, parts: tuple[float, ...]) -> list[int]:
    """Return the slots of regions of these parts of the garment, in full words, and of all of it last.

    Raises `ValueError` for a part that is none: 0 or less, or more than 1.
    """
    whole = whole_size(tables)
    for part in parts:
        if not 0 < part <= 1:
            raise ValueError(f"a region of {part:g} garments; give parts of the garment, between 0 and 1.")
    sizes = {WORD * math.ceil(part * whole / WORD) for part in parts}
    return [*sorted(size for size in sizes if size < whole), whole]


@noinline
def find_members(moving: Bool[Array, " n"], tables: CollisionTables) -> Members:
    """Return the moving vertices and their one-rings: an energy on these has the whole mesh's gradient."""
    n, whole = len(tables.index), whole_size(tables)
    touched, order = dilate(moving, tables, 1), jnp.asarray(tables.order)
    words = pack_words(jnp.pad(touched[order], (0, -n % WORD)).reshape(-1, 1, WORD))
    up_to = marked_up_to(words)
    word, place, own = select(0, whole, words, up_to)
    vertex = order[jnp.minimum(word * WORD + place, n - 1)]
    local = jnp.full(n, whole, jnp.int32)
    local = local.at[jnp.where(own, vertex, n)].set(jnp.arange(whole, dtype=jnp.int32), mode="drop")
    return Members(moving, vertex, local, up_to[-1])


@noinline
def make_region(members: Members, tables: CollisionTables, size: int) -> Region:
    """Return the region of the members, which must be fewer than `size`.

    Its first places are those of a smaller region (`first_places`).
    """
    vertex, own = members.vertex[:size], jnp.arange(size) < members.count
    weight, back = (
        jnp.where(own[None], jnp.asarray(w)[vertex].T, 0.0) for w in (tables.weight, tables.weight_back)
    )
    index = jnp.minimum(members.local, size - 1)[jnp.asarray(tables.index)[vertex].T]
    return Region(vertex, own, own & members.moving[vertex], index, weight, back, weight.sum(axis=0))


def first_places(region: Region, size: int) -> Region:
    """Return the region of its first `size` places, which must be more than its members."""
    first = Region(*(leaf[..., :size] for leaf in region))
    return first._replace(index=jnp.minimum(first.index, size - 1))


def smoothness(x: Float[Array, "3 m"], region: Region) -> Float[Array, ""]:
    """Return 1/2 ||Lap x||^2 for a displacement `x` (metres, coordinates first; zero outside the region)."""
    r = stretch(x, region.index, region.weight, region.weight_back, region.total)
    return 0.5 * (r * r).sum()


@jax.custom_vjp
def stretch(
    x: Float[Array, "3 m"],
    index: Int[Array, "k m"],
    weight: Float[Array, "k m"],
    weight_back: Float[Array, "k m"],
    total: Float[Array, " m"],
) -> Float[Array, "m 3"]:
    """Return the Laplacian `[m, 3]` of `x` `[3, m]`; its gradient is a gather with the transposed weights.

    Differentiated by itself the gather would become a scatter, several times slower on a CPU. What is
    gathered has the coordinates last: three in a row take two thirds of the time of three apart.
    """
    return _apply(fusion_barrier(x.T), index, weight, total)


def _apply(
    x: Float[Array, "m 3"], index: Int[Array, "k m"], weight: Float[Array, "k m"], total: Float[Array, " m"]
) -> Float[Array, "m 3"]:
    away = -total[:, None] * x
    if len(index) > UNROLLED:
        return away + (_neighbours(x, index) * weight[..., None]).sum(axis=0)
    for row, factor in zip(index, weight, strict=True):  # a gather each: all at once take half as long again
        away = away + factor[:, None] * _neighbours(x, row)
    return away


def _neighbours(x: Float[Array, "m 3"], index: Int[Array, "*k m"]) -> Float[Array, "*k m 3"]:
    return x.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)


def _backward(saved: tuple[Array, Array, Array], r: Float[Array, "m 3"]):
    index, weight_back, total = saved
    r = fusion_barrier(r)  # it would be computed anew for every neighbour
    slope = fusion_barrier(_apply(r, index, weight_back, total))  # turned while made, it takes longer
    return slope.T, None, None, None, None


stretch.defvjp(lambda *args: (stretch(*args), (args[1], *args[3:])), _backward)
