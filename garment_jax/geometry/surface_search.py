"""The search behind `closest_point`: which triangle of a posed mesh is nearest to each point.

Points come in groups of 8 that lie together and triangles in leaves of 16, each in its box. Pairs of
boxes that can matter to each other are marked in one dense pass, a bit a pair; of each marked pair, the
points whose own limit reaches the leaf are marked; what is left is tested, a chunk at a time. The cost
follows the number of marks, however many there are, and nothing can overflow.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from garment_jax.geometry.marked import WORD, marked_up_to, pack, pack_words, select
from garment_jax.geometry.surface_tables import LEAF, SurfaceTables
from garment_jax.geometry.triangle import squared_distance

PAIRS = 512  # pairs of a group and a leaf taken at a time
TESTS = 512  # pairs of a point and a leaf tested at a time
_NOWHERE = 1e15  # metres: no limit reaches a box that is only padding, and its square is finite


class PosedSurface(NamedTuple):
    """One frame's mesh, ready to be searched several times."""

    vertices: jax.Array  # [c, 3] relative to origin
    origin: jax.Array  # [3] taken off all coordinates, for float32's digits far from zero
    corners: jax.Array  # [l, LEAF, 3, 3] of the triangles, leaf by leaf
    middle: jax.Array  # [l, 3] of the leaves' boxes
    half: jax.Array  # [l, 3] half their edges


class Nearest(NamedTuple):
    """The answer of a search over `g` groups of points."""

    triangle: jax.Array  # [g, s] int32 row of the tables' faces, -1 where nothing lay within the limit
    squared: jax.Array  # [g, s] square metres to it, or the limit's square


def pose_surface(vertices: Float[Array, "c 3"], tables: SurfaceTables) -> PosedSurface:
    """Return the searchable form of the mesh at `vertices` (any frame, metres)."""
    vertices = jnp.asarray(vertices)
    origin = vertices.mean(axis=0)
    vertices = vertices - origin[None]
    corners = vertices[jnp.asarray(tables.faces).reshape(-1, LEAF, 3)]
    low, high = corners.min(axis=(1, 2)), corners.max(axis=(1, 2))
    return PosedSurface(vertices, origin, corners, (low + high) / 2, (high - low) / 2)


def search(points: Float[Array, "g s 3"], limit: Float[Array, "g s"], surface: PosedSurface) -> Nearest:
    """Return the nearest triangle of each point within its own `limit` (metres; below 0: not asked).

    `points` are relative to `surface.origin`. In float32, of triangles whose squared distances
    differ by less than two millionths, either may be returned. Not differentiable.
    """
    g, s = limit.shape
    words = _marks(points, limit, surface)
    up_to = marked_up_to(words)
    flat = points.reshape(-1, 3)

    def pairs(state):
        at, key, where = state
        group, leaf, valid = select(at, PAIRS, words, up_to)
        inner = pack(_reached(points[group], limit[group], leaf, surface) & valid[:, None])
        inner_up_to = marked_up_to(inner)

        def tests(state):
            at, key, where = state
            pair, member, valid = select(at, TESTS, inner, inner_up_to)
            point, its = group[pair] * s + member, leaf[pair]
            squared = squared_distance(flat[point], surface.corners[its])
            found = _key(squared, jnp.arange(LEAF, dtype=jnp.int32)[None]).min(axis=-1)
            point = jnp.where(valid, point, g * s)
            key = key.at[point].min(found, mode="drop")
            won = valid & (key.at[point].get(mode="clip") == found)
            where = where.at[jnp.where(won, point, g * s)].set(its, mode="drop")
            return at + TESTS, key, where

        _, key, where = jax.lax.while_loop(
            lambda s: s[0] < inner_up_to[-1], tests, (jnp.int32(0), key, where)
        )
        return at + PAIRS, key, where

    key = _key(jnp.where(limit < 0, 0.0, limit * limit).reshape(-1), LEAF - 1)
    start = (jnp.int32(0), key, jnp.full(g * s, -1, jnp.int32))
    _, key, where = jax.lax.while_loop(lambda state: state[0] < up_to[-1], pairs, start)
    triangle = jnp.where(where < 0, -1, where * LEAF + (key & (LEAF - 1)).astype(jnp.int32))
    digits = jnp.float64 if key.dtype == jnp.int64 else jnp.float32
    squared = jax.lax.bitcast_convert_type(key & ~(LEAF - 1), digits).astype(limit.dtype)
    return Nearest(triangle.astype(jnp.int32).reshape(g, s), squared.reshape(g, s))


def _key(squared: Array, slots: Array | int) -> Array:
    """Return integers ordered like `squared` (>= 0) with the slot in the four lowest bits.

    An integer minimum vectorises where an arg-minimum does not; the price is 2^-19 of the square in
    float32 and 2^-48 in float64.
    """
    if squared.dtype == jnp.float64:
        return (jax.lax.bitcast_convert_type(squared, jnp.int64) & ~(LEAF - 1)) | slots
    return (jax.lax.bitcast_convert_type(squared.astype(jnp.float32), jnp.int32) & ~(LEAF - 1)) | slots


def group_boxes(points: Float[Array, "g s 3"], asked: Array) -> tuple[Array, Array]:
    """Return middles and half edges `[g, 3]` of the boxes around the groups' asked points."""
    low = jnp.where(asked[..., None], points, jnp.inf).min(axis=1)
    high = jnp.where(asked[..., None], points, -jnp.inf).max(axis=1)
    nobody = low > high
    return jnp.where(nobody, -_NOWHERE, (low + high) / 2), jnp.where(nobody, 0.0, (high - low) / 2)


def box_gap_squared(middle: Array, half: Array, other_middle: Array, other_half: Array) -> Array:
    """Return the squared distances of boxes, `[..., 3]` each, broadcast against each other."""
    gap = jnp.maximum(jnp.abs(middle - other_middle) - (half + other_half), 0.0)
    return (gap * gap).sum(axis=-1)


def _marks(points, limit, surface) -> Array:
    """Return the marks `[g, l / 32]` of the pairs of a group and a leaf that may hold a closest point."""
    asked = limit >= 0
    middle, half = group_boxes(points, asked)
    widest = jnp.minimum(jnp.where(asked, limit, 0.0).max(axis=1), 1e-3 * _NOWHERE)[:, None, None]
    # padded and cut into words before the dense pass, which XLA would otherwise do in every element
    fill = ((0, 0), (0, -len(surface.half) % WORD))
    leaf_middle = jnp.pad(surface.middle.T, fill, constant_values=_NOWHERE).reshape(3, 1, -1, WORD)
    leaf_half = jnp.pad(surface.half.T, fill).reshape(3, 1, -1, WORD)
    squared = jnp.zeros(())
    for x in range(3):
        room = half[:, x, None, None] + leaf_half[x]
        gap = jnp.maximum(jnp.abs(middle[:, x, None, None] - leaf_middle[x]) - room, 0.0)
        squared = squared + gap * gap
    return pack_words(squared <= widest * widest)


def _reached(points, limit, leaf, surface) -> Array:
    """Return which points `[k, s]` have the leaf `[k]` of their pair within their own limit."""
    away = jnp.abs(points - surface.middle[leaf][:, None]) - surface.half[leaf][:, None]
    squared = (jnp.maximum(away, 0.0) ** 2).sum(axis=-1)
    return (squared <= limit * limit) & (limit >= 0)


def distance_to(
    triangle: Int[Array, " n"], points: Float[Array, "n 3"], surface: PosedSurface
) -> Float[Array, " n"]:
    """Return the distance to a named triangle, a hair too large: an upper bound for the nearest one."""
    corners = surface.corners.reshape(-1, 1, 3, 3)[triangle]
    squared = squared_distance(points, corners)[:, 0]
    return jnp.sqrt(squared) * (1 + 1e-4) + 1e-6


def distance_to_any(points: Float[Array, "n 3"], surface: PosedSurface) -> Float[Array, " n"]:
    """Return the distance to the nearest leaf's first corner: an upper bound from nothing."""
    corners = surface.corners[:, 0, 0]
    squared = ((points[:, None] - corners[None]) ** 2).sum(axis=-1)
    return jnp.sqrt(squared.min(axis=1)) * (1 + 1e-4) + 1e-6
