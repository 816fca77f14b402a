"""The part of a garment that a solve may move, gathered into small arrays, and its smooth energy."""

import math
from functools import reduce
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from garment_jax.geometry.bitset import WORD, marked, places
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


def region_sizes(tables: CollisionTables, parts: tuple[float, ...]) -> list[int]:
    """Return the slots of regions of these parts of the garment, in full words, and of all of it last.

    Raises `ValueError` for a part that is none: 0 or less, or more than 1.
    """
    n = len(tables.index) + 1  # of the whole garment and what stays put
    whole = n + -n % WORD
    for part in parts:
        if not 0 < part <= 1:
            raise ValueError(f"a region of {part:g} garments; give parts of the garment, between 0 and 1.")
    sizes = {WORD * math.ceil(part * whole / WORD) for part in parts}
    return [*sorted(size for size in sizes if size < whole), whole]


@noinline
def find_members(moving: Bool[Array, " n"], tables: CollisionTables) -> Members:
    """Return the moving vertices and their one-rings: an energy on these has the whole mesh's gradient."""
    n, whole = len(tables.index), region_sizes(tables, ())[-1]
    touched, order = dilate(moving, tables, 1), jnp.asarray(tables.order)
    words, up_to = marked(touched[order])
    here, to = places(0, whole, words, up_to, n)
    vertex, own = order[here], to < n
    local = jnp.full(n, whole, jnp.int32)
    local = local.at[jnp.where(own, vertex, n)].set(jnp.arange(whole, dtype=jnp.int32), mode="drop")
    return Members(moving, vertex, local, up_to[-1])


@noinline
def make_region(members: Members, tables: CollisionTables, size: int) -> Region:
    """Return the region of the members, which must be fewer than `size`.

    Its first places are those of a smaller region (`descent.first_places`).
    """
    vertex, own = members.vertex[:size], jnp.arange(size) < members.count
    weight, back = (
        jnp.where(own[None], jnp.asarray(w)[vertex].T, 0.0) for w in (tables.weight, tables.weight_back)
    )
    index = jnp.minimum(members.local, size - 1)[jnp.asarray(tables.index)[vertex].T]
    return Region(vertex, own, own & members.moving[vertex], index, weight, back, weight.sum(axis=0))


def smoothness(x: Float[Array, "3 m"], region: Region) -> Float[Array, ""]:
    """Return 1/2 ||Lap x||^2 for a displacement `x` (metres, coordinates first; zero outside the region)."""
    r = _laplacian(fusion_barrier(x.T), region, region.weight)
    return 0.5 * (r * r).sum()


def smoothness_gradient(x: Float[Array, "3 m"], region: Region) -> Float[Array, "3 m"]:
    """Return Lap^T Lap x, by gathers alone: differentiated by itself a gather would become a scatter."""
    # what is gathered would be computed anew for every neighbour
    r = fusion_barrier(_laplacian(fusion_barrier(x.T), region, region.weight))
    return fusion_barrier(_laplacian(r, region, region.weight_back)).T  # turned while made, it takes longer


def _laplacian(x: Float[Array, "m 3"], region: Region, weight: Float[Array, "k m"]) -> Float[Array, "m 3"]:
    """Return sum_k w_ik (x_k - x_i); with `weight_back` its transpose.

    `elastic` and `stencil` have other layouts: here the neighbours are a frame's own, and what is gathered
    has the coordinates last, for three in a row take two thirds of the time of three apart.
    """
    y = -region.total[:, None] * x
    # a gather for each neighbour: all at once take half as long again
    for k in [slice(None)] if len(weight) > UNROLLED else range(len(weight)):
        near = x.at[region.index[k]].get(mode="promise_in_bounds", wrap_negative_indices=False)
        near = weight[k][..., None] * near
        y = y + (near if near.ndim == 2 else near.sum(axis=0))
    return y
