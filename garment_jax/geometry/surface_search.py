"""The search behind `closest_point`: which triangle of a posed mesh is nearest to each point.

Points come in groups of 8 that lie together and triangles in leaves of 16, 4 leaves a branch, each in its
box, a leaf between two planes as well. Pairs of a group and a branch that can matter to each other are
marked in one dense pass, a bit a pair; of each marked pair, the points and leaves within the point's own
limit are marked; what is left is tested, a chunk at a time. The cost follows the number of marks, however
many there are, and nothing can overflow.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt32

from garment_jax.geometry.marked import WORD, marked_up_to, pack, select, word_bits
from garment_jax.geometry.stencil import materialised
from garment_jax.geometry.surface_tables import BRANCH, LEAF, SurfaceTables
from garment_jax.geometry.triangle import cross, dot, squared_distance, squared_length

PAIRS = 512  # pairs of a group and a branch taken at a time
TESTS = 256  # pairs of a point and a leaf tested at a time
SLACK = 1e-6  # metres: rounding of a height above a plane, for surfaces of a few metres
_NOWHERE = 1e15  # metres: no limit reaches a box that is only padding, and its square is finite


class PosedSurface(NamedTuple):
    """One frame's mesh, ready to be searched several times."""

    vertices: jax.Array  # [c, 3] relative to origin
    flat: jax.Array  # [3 c] the same, coordinate after coordinate: gathered from without a division
    corners: jax.Array  # [l, 9 LEAF] of each leaf's triangles: coordinate, corner, triangle
    origin: jax.Array  # [3] taken off all coordinates, for float32's digits far from zero
    middle: jax.Array  # [3, l] of the leaves' boxes
    half: jax.Array  # [3, l] half their edges
    slab: jax.Array  # [5, l] unit normal, middle and half thickness of a leaf between two planes
    low: jax.Array  # [3, b] least coordinates of the branches' boxes
    high: jax.Array  # [3, b] greatest
    branch_slab: jax.Array  # [5, b] as `slab`, of a branch


class Nearest(NamedTuple):
    """The answer of a search over `g` groups of `s` points."""

    triangle: jax.Array  # [s, g] int32 row of the tables' faces, -1 where nothing lay within the limit
    squared: jax.Array  # [s, g] square metres to it, or the limit's square


def pose_surface(vertices: Float[Array, "c 3"], tables: SurfaceTables) -> PosedSurface:
    """Return the searchable form of the mesh at `vertices` (any frame, metres)."""
    vertices = jnp.asarray(vertices)
    origin = vertices.mean(axis=0)
    vertices = vertices - origin[None]
    # coordinate after coordinate, leaves last: what XLA runs eight at a time
    flat = materialised(vertices.T).reshape(-1)
    leaves = materialised(coordinates_of(jnp.asarray(tables.corners).T, flat))
    low, high = leaves.min(axis=1), leaves.max(axis=1)
    branch_low, branch_high = low.reshape(3, -1, BRANCH).min(axis=2), high.reshape(3, -1, BRANCH).max(axis=2)
    slab = _slabs(leaves, _normals(jnp.asarray(tables.spread), flat), 1)
    branch_slab = _slabs(leaves, _normals(jnp.asarray(tables.branch_spread), flat), BRANCH)
    named = jnp.asarray(tables.faces).reshape(-1, LEAF, 3).transpose(0, 2, 1).reshape(-1, 1, 3 * LEAF)
    named = named + len(vertices) * jnp.arange(3, dtype=jnp.int32)[None, :, None]
    corners = _gathered(flat, named.reshape(len(named), -1))
    return PosedSurface(
        vertices,
        flat,
        corners,
        origin,
        (low + high) / 2,
        (high - low) / 2,
        slab,
        branch_low,
        branch_high,
        branch_slab,
    )


def _normals(spread: Int[Array, "3 k"], flat: Float[Array, " c3"]) -> Float[Array, "3 k"]:
    """Return the unit normals of the triangles of these vertices; 0 where they are on a line."""
    at = coordinates_of(spread, flat)
    n = jnp.stack(cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]))
    length = jnp.sqrt(squared_length(n))
    return materialised(n / jnp.where(length > 0, length, 1.0)[None])


def _slabs(leaves: Float[Array, "3 u l"], n: Float[Array, "3 k"], many: int) -> Float[Array, "5 k"]:
    """Return normals, middles and half thicknesses of `many` leaves each between planes along `n`.

    `leaves`: coordinate, vertex, leaf. A patch of skin is flat: its box is several times thicker. Any normal
    is right, a good one is thin; with none at all (a leaf without area) nothing is excluded.
    """
    height = dot(leaves, n.repeat(many, axis=1)[:, None])
    low, high = (
        height.min(axis=0).reshape(-1, many).min(axis=1),
        height.max(axis=0).reshape(-1, many).max(axis=1),
    )
    return jnp.concatenate([n, jnp.stack([(low + high) / 2, (high - low) / 2 + SLACK])])


def search(
    points: Float[Array, "3 s g"],
    limit: Float[Array, "s g"],
    surface: PosedSurface,
    tables: SurfaceTables,
    words: UInt32[Array, "w g"] | None = None,
) -> Nearest:
    """Return the nearest triangle of each point within its own `limit` (metres; below 0: not asked).

    `words` are the branches that may matter to a group (`branches_within`), where they are known.
    `points` are relative to `surface.origin`. In float32, of triangles whose squared distances
    differ by less than two millionths, either may be returned. Not differentiable.
    """
    s, g = limit.shape
    words = (_marks(points, limit, surface) if words is None else words).T
    up_to, flat = marked_up_to(words), points.reshape(3, -1)
    rows, limits = materialised((points.transpose(2, 0, 1), limit.T))

    def pairs(state):
        at, key, where = state
        group, branch, valid = select(at, PAIRS, words, up_to)
        # a place is a leaf of the branch and a point of the group
        reached = _reached(rows[group], limits[group], branch, surface)
        inner = pack((reached & valid[:, None, None]).reshape(PAIRS, -1))
        inner_up_to = marked_up_to(inner)

        def tests(state):
            at, key, where = state
            pair, place, valid = select(at, TESTS, inner, inner_up_to)
            point, its = materialised((place % s * g + group[pair], branch[pair] * BRANCH + place // s))
            corners = surface.corners[its].reshape(TESTS, 3, 3, LEAF).transpose(1, 2, 0, 3)
            squared = squared_distance(flat[:, point], corners)
            found = _key(materialised(squared), jnp.arange(LEAF, dtype=jnp.int32)[None]).min(axis=-1)
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
    return Nearest(triangle.astype(jnp.int32).reshape(s, g), squared.reshape(s, g))


def coordinates_of(rows: Int[Array, "*k"], flat: Float[Array, " c3"]) -> Array:
    """Return the coordinates `[3, *k]` of these vertices, of all coordinates one after the other."""
    first = len(flat) // 3 * jnp.arange(3, dtype=jnp.int32).reshape(3, *(1 for _ in rows.shape))
    return _gathered(flat, rows[None] + first)


def _gathered(flat: Array, places: Array) -> Array:
    return flat.at[places].get(mode="promise_in_bounds", wrap_negative_indices=False)


def _key(squared: Array, slots: Array | int) -> Array:
    """Return integers ordered like `squared` (>= 0) with the slot in the four lowest bits.

    An integer minimum vectorises where an arg-minimum does not; the price is 2^-19 of the square in
    float32 and 2^-48 in float64.
    """
    if squared.dtype == jnp.float64:
        return (jax.lax.bitcast_convert_type(squared, jnp.int64) & ~(LEAF - 1)) | slots
    return (jax.lax.bitcast_convert_type(squared.astype(jnp.float32), jnp.int32) & ~(LEAF - 1)) | slots


def group_boxes(points: Float[Array, "3 s g"], asked: Bool[Array, "s g"]) -> tuple[Array, Array]:
    """Return the least and greatest coordinates `[3, g]` of groups' asked points; inf, -inf for nobody."""
    low = jnp.where(asked[None], points, jnp.inf).min(axis=1)
    high = jnp.where(asked[None], points, -jnp.inf).max(axis=1)
    return low, high


def branch_gap_squared(low: Float[Array, "3 g"], high: Float[Array, "3 g"], surface: PosedSurface) -> Array:
    """Return the squared distances `[w, g]` of boxes to the branches', of which there are w in full words."""
    fill = ((0, 0), (0, -surface.low.shape[1] % WORD))  # before the dense pass: it would be done in it
    least, greatest = (jnp.pad(x, fill, constant_values=_NOWHERE) for x in (surface.low, surface.high))
    squared = jnp.zeros(())
    for x in range(3):
        apart = jnp.maximum(least[x][:, None] - high[x][None], low[x][None] - greatest[x][:, None])
        gap = jnp.maximum(apart, 0.0)
        squared = squared + gap * gap
    return squared


def branches_within(gap_squared: Float[Array, "w g"], widest: Float[Array, " g"]) -> Array:
    """Return the marks `[w / 32, g]` of the branches no farther from their group than `widest` (metres)."""
    widest = jnp.minimum(widest, 1e-3 * _NOWHERE)
    squared = jnp.where(widest < 0, -1.0, widest * widest)
    # the groups last: a sum over the last axis takes five times as long
    within = gap_squared.reshape(-1, WORD, len(widest)) <= squared[None, None]
    return jnp.where(within, word_bits()[None, :, None], jnp.uint32(0)).sum(axis=1, dtype=jnp.uint32)


def _marks(points: Float[Array, "3 s g"], limit, surface) -> Array:
    """Return the marks `[w / 32, g]` of the pairs of a group and a branch that may hold a closest point."""
    gap = branch_gap_squared(*group_boxes(points, limit >= 0), surface)
    return branches_within(gap, limit.max(axis=0))


def _reached(points: Float[Array, "k 3 s"], limit, branch, surface) -> Array:
    """Return which leaves and points `[k, BRANCH, s]` of each pair lie within the point's own limit."""
    boxes = jnp.concatenate([surface.middle, surface.half, surface.slab])
    boxes = boxes.reshape(11, -1, BRANCH).transpose(1, 0, 2)[branch][..., None]
    points = points[:, :, None]
    squared, height = jnp.zeros(()), -boxes[:, 9]
    for x in range(3):
        gap = jnp.maximum(jnp.abs(points[:, x] - boxes[:, x]) - boxes[:, 3 + x], 0.0)
        squared = squared + gap * gap
        height = height + points[:, x] * boxes[:, 6 + x]
    gap = jnp.maximum(jnp.abs(height) - boxes[:, 10], 0.0)
    squared = jnp.maximum(squared, gap * gap)
    return (materialised(squared) <= (limit * limit)[:, None]) & (limit >= 0)[:, None]


def distance_to(
    triangle: Int[Array, " n"], points: Float[Array, "3 n"], surface: PosedSurface, tables: SurfaceTables
) -> Float[Array, " n"]:
    """Return the distance to a named triangle, a hair too large: an upper bound for the nearest one."""
    vertex = materialised(jnp.asarray(tables.faces)[triangle].T)
    corners = materialised(coordinates_of(vertex, surface.flat))
    squared = squared_distance(points, corners[..., None])[:, 0]
    return jnp.sqrt(squared) * (1 + 1e-4) + 1e-6


def distance_to_corner(
    triangle: Int[Array, " n"], points: Float[Array, "n 3"], surface: PosedSurface, tables: SurfaceTables
) -> Float[Array, " n"]:
    """Return the distance to the first corner of a named triangle: a bound at a tenth of the cost."""
    away = points - surface.vertices[jnp.asarray(tables.faces)[:, 0][triangle]]
    return jnp.sqrt((away * away).sum(axis=-1)) * (1 + 1e-4) + 1e-6


def nearest_leaf(
    points: Float[Array, "n 3"], surface: PosedSurface, tables: SurfaceTables
) -> Int[Array, " n"]:
    """Return the row of the triangle whose corner is the nearest of one a leaf: a guess from nothing."""
    corners = surface.vertices[jnp.asarray(tables.faces)[::LEAF, 0]]
    squared = ((points[:, None] - corners[None]) ** 2).sum(axis=-1)
    return LEAF * squared.argmin(axis=1).astype(jnp.int32)
