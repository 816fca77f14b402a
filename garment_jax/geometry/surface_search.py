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
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt32

from garment_jax.geometry.bitset import WORD, marked_up_to, pack, select, word_bits
from garment_jax.geometry.gather import coordinates_of, first_numbers, numbers_at
from garment_jax.geometry.noinline import fusion_barrier, noinline
from garment_jax.geometry.surface_tables import BRANCH, LEAF, SurfaceTables
from garment_jax.geometry.triangle import cross, dot, most, squared_distance, squared_length

PAIRS = 512  # pairs of a group and a branch taken at a time
TESTS = 256  # pairs of a point and a leaf tested at a time
SLACK = 1e-6  # metres: rounding of a height above a plane, for surfaces of a few metres
_NOWHERE = 1e15  # metres: no limit reaches a box that is only padding, and its square is finite


class PosedSurface(NamedTuple):
    """One frame's mesh, ready to be searched several times."""

    flat: jax.Array  # [3 c] relative to origin, coordinate after coordinate: gathered without a division
    corners: jax.Array  # [l, 9 LEAF] of each leaf's triangles: coordinate, corner, triangle
    origin: jax.Array  # [3] taken off all coordinates, for float32's digits far from zero
    bounds: jax.Array  # [b, 11, BRANCH] of each leaf: its box' middle and half edges, its `branch_slab`
    low: jax.Array  # [3, b] least coordinates of the branches' boxes
    high: jax.Array  # [3, b] greatest
    branch_slab: jax.Array  # [5, b] unit normal, middle and half thickness of a branch between two planes


class Nearest(NamedTuple):
    """The answer of a search over `g` groups of `s` points."""

    triangle: jax.Array  # [s, g] int32 row of the tables' faces, -1 where nothing lay within the limit
    squared: jax.Array  # [s, g] square metres to it, or the limit's square


@noinline
def pose_surface(vertices: Float[Array, "c 3"], tables: SurfaceTables) -> PosedSurface:
    """Return the searchable form of the mesh at `vertices` (any frame, metres)."""
    flat, origin = _centred(jnp.asarray(vertices))
    leaves = coordinates_of(tables.corners.T, flat)  # leaves last: what XLA runs eight at a time
    slab = _slabs(leaves, _normals(tables.spread, flat), 1)
    branch_slab = _slabs(leaves, _normals(tables.branch_spread, flat), BRANCH)
    bounds, low, high = _boxes(leaves, slab)
    return PosedSurface(flat, _corner_rows(flat, tables), origin, bounds, low, high, branch_slab)


@noinline
def _centred(vertices: Float[Array, "c 3"]) -> tuple[Array, Array]:
    """Return the coordinates one after the other, from the mean of all vertices, and that."""
    planes = fusion_barrier(vertices.T)
    origin = planes.mean(axis=1)
    return (planes - origin[:, None]).reshape(-1), origin


@noinline
def _boxes(leaves: Float[Array, "3 u l"], slab: Float[Array, "5 l"]) -> tuple[Array, Array, Array]:
    """Return `bounds`, `low` and `high` of `PosedSurface`."""
    low, high = leaves.min(axis=1), leaves.max(axis=1)
    bounds = jnp.concatenate([(low + high) / 2, (high - low) / 2, slab])
    bounds = bounds.reshape(11, -1, BRANCH).transpose(1, 0, 2)
    return bounds, low.reshape(3, -1, BRANCH).min(axis=2), high.reshape(3, -1, BRANCH).max(axis=2)


@noinline
def _corner_rows(flat: Float[Array, " c3"], tables: SurfaceTables) -> Float[Array, "l k"]:
    named = tables.faces.reshape(-1, LEAF, 3).transpose(0, 2, 1).reshape(-1, 1, 3 * LEAF)
    named = named + first_numbers(flat).reshape(1, 3, 1)
    return numbers_at(named.reshape(len(named), -1), flat)


@noinline
def _normals(spread: Int[Array | np.ndarray, "3 k"], flat: Float[Array, " c3"]) -> Float[Array, "3 k"]:
    """Return the unit normals of the triangles of these vertices; 0 where they are on a line."""
    at = coordinates_of(spread, flat)
    n = jnp.stack(cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]))
    length = jnp.sqrt(squared_length(n))
    return n / jnp.where(length > 0, length, 1.0)[None]


@noinline
def _slabs(leaves: Float[Array, "3 u l"], n: Float[Array, "3 k"], many: int) -> Float[Array, "5 k"]:
    """Return normals, middles and half thicknesses of `many` leaves each between planes along `n`.

    `leaves`: coordinate, vertex, leaf. A patch of skin is flat: its box is several times thicker. Any normal
    is right, a good one is thin; with none at all (a leaf without area) nothing is excluded.
    """
    height = fusion_barrier(dot(leaves, n.repeat(many, axis=1)[:, None]))
    low, high = fusion_barrier((height.min(axis=0), height.max(axis=0)))
    low, high = low.reshape(-1, many).min(axis=1), high.reshape(-1, many).max(axis=1)
    return jnp.concatenate([n, jnp.stack([(low + high) / 2, (high - low) / 2 + SLACK])])


@noinline
def search(
    points: Float[Array, "3 s g"],
    limit: Float[Array, "s g"],
    surface: PosedSurface,
    *,
    at_once: int = PAIRS,
) -> Nearest:
    """Return the nearest triangle of each point within its own `limit` (metres; below 0: not asked).

    `at_once`: how many pairs of a group and a branch are taken at a time, fewer for few groups.
    `points` are relative to `surface.origin`. In float32, of triangles whose squared distances
    differ by less than two millionths, either may be returned. Not differentiable.
    """
    found = _tested(
        *_rows(_marks(points, limit, surface), points, limit),
        *_nothing_found(limit),
        points,
        surface,
        at_once,
    )
    return _nearest(*found, limit)


@noinline
def _tested(
    words: UInt32[Array, "g w"],
    rows: Float[Array, "g 3 s"],
    limits: Float[Array, "g s"],
    key: Int[Array, " n"],
    where: Int[Array, " n"],
    points: Float[Array, "3 s g"],
    surface: PosedSurface,
    at_once: int,
):
    """Return the keys and the leaves of what is nearest; `at_once` of the pairs that are marked at a time."""
    up_to, flat, shape = marked_up_to(words), points.reshape(3, -1), points.shape[1:]

    def pairs(state: tuple[Array, Array, Array]):
        at, key, where = state
        group, branch, valid = select(at, at_once, words, up_to)
        inner = _inner(rows, limits, group, branch, valid, surface)
        inner_up_to = marked_up_to(inner)

        def tests(state: tuple[Array, Array, Array]):
            at, key, where = state
            pair, place, valid = select(at, TESTS, inner, inner_up_to)
            point, its, target = _named(pair, place, valid, group, branch, shape)
            found = _nearest_in(flat, point, surface.corners, its)
            return at + TESTS, *_noted(key, where, found, its, target, valid)

        _, key, where = jax.lax.while_loop(
            lambda s: s[0] < inner_up_to[-1], tests, (jnp.int32(0), key, where)
        )
        return at + at_once, key, where

    start = jnp.int32(0), key, where
    return jax.lax.while_loop(lambda state: state[0] < up_to[-1], pairs, start)[1:]


@noinline
def _nothing_found(limit: Float[Array, "s g"]) -> tuple[Array, Array]:
    key = _key(jnp.where(limit < 0, 0.0, limit * limit).reshape(-1), LEAF - 1)
    return key, jnp.full(limit.size, -1, jnp.int32)


@noinline
def _nearest(key: Int[Array, " n"], where: Int[Array, " n"], limit: Float[Array, "s g"]) -> Nearest:
    triangle = jnp.where(where < 0, -1, where * LEAF + (key & (LEAF - 1)).astype(jnp.int32))
    digits = jnp.float64 if key.dtype == jnp.int64 else jnp.float32
    squared = jax.lax.bitcast_convert_type(key & ~(LEAF - 1), digits).astype(limit.dtype)
    return Nearest(triangle.astype(jnp.int32).reshape(limit.shape), squared.reshape(limit.shape))


@noinline
def _rows(words: UInt32[Array, "w g"], points: Float[Array, "3 s g"], limit: Float[Array, "s g"]):
    """Return the same, group after group: what is looked up there lies together."""
    return words.T, points.transpose(2, 0, 1), limit.T


@noinline
def _inner(
    rows: Float[Array, "g 3 s"],
    limits: Float[Array, "g s"],
    group: Int[Array, " k"],
    branch: Int[Array, " k"],
    valid: Bool[Array, " k"],
    surface: PosedSurface,
) -> UInt32[Array, "k w"]:
    """Return the marks of each pair's leaves and points within the point's own limit, leaf after leaf."""
    reached = _reached(*_looked_up(rows, limits, surface.bounds, group, branch))
    return pack((reached & valid[:, None, None]).reshape(len(group), -1))


@noinline
def _looked_up(
    rows: Float[Array, "g 3 s"],
    limits: Float[Array, "g s"],
    bounds: Float[Array, "b 11 l"],
    group: Int[Array, " k"],
    branch: Int[Array, " k"],
) -> tuple[Array, Array, Array]:
    return rows[group], limits[group], bounds[branch]


@noinline
def _named(
    pair: Int[Array, " t"],
    place: Int[Array, " t"],
    valid: Bool[Array, " t"],
    group: Int[Array, " k"],
    branch: Int[Array, " k"],
    shape: tuple[int, ...],
) -> tuple[Array, Array, Array]:
    """Return the point and the leaf of each test, and where the point's answer is kept: nowhere, beyond."""
    s, g = shape
    point = place % s * g + group[pair]
    return point, branch[pair] * BRANCH + place // s, jnp.where(valid, point, s * g)


@noinline
def _nearest_in(
    flat: Float[Array, "3 n"], point: Int[Array, " t"], corners: Float[Array, "l c"], its: Int[Array, " t"]
) -> Int[Array, " k"]:
    """Return the least key of each test's triangles."""
    rows = corners[its].reshape(-1, 3, 3, LEAF).transpose(1, 2, 0, 3)
    squared = fusion_barrier(squared_distance(flat[:, point], rows))
    return _key(squared, jnp.arange(LEAF, dtype=jnp.int32)[None]).min(axis=-1)


@noinline
def _noted(
    key: Int[Array, " n"],
    where: Int[Array, " n"],
    found: Int[Array, " t"],
    its: Int[Array, " t"],
    target: Int[Array, " t"],
    valid: Bool[Array, " t"],
) -> tuple[Array, Array]:
    """Return the keys and leaves with what was found written `target` its place."""
    key = key.at[target].min(found, mode="drop")
    won = valid & (key.at[target].get(mode="clip") == found)
    return key, where.at[jnp.where(won, target, len(key))].set(its, mode="drop")


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
    lowest, highest = (jnp.pad(x, fill, constant_values=_NOWHERE) for x in (surface.low, surface.high))
    squared = jnp.zeros(())
    for x in range(3):
        gap = most(most(lowest[x][:, None] - high[x][None], low[x][None] - highest[x][:, None]), 0.0)
        squared = squared + gap * gap
    return squared


def branches_within(gap_squared: Float[Array, "w g"], widest: Float[Array, " g"]) -> Array:
    """Return the marks `[w / 32, g]` of the branches no farther from their group than `widest` (metres)."""
    widest = jnp.minimum(widest, 1e-3 * _NOWHERE)
    squared = jnp.where(widest < 0, -1.0, widest * widest)
    # the groups last: a sum over the last axis takes five times as long
    within = gap_squared.reshape(-1, WORD, len(widest)) <= squared[None, None]
    return jnp.where(within, word_bits()[None, :, None], jnp.uint32(0)).sum(axis=1, dtype=jnp.uint32)


@noinline
def _marks(points: Float[Array, "3 s g"], limit: Float[Array, "s g"], surface: PosedSurface) -> Array:
    """Return the marks `[w / 32, g]` of the pairs of a group and a branch that may hold a closest point."""
    low, high, widest = fusion_barrier((*group_boxes(points, limit >= 0), limit.max(axis=0)))
    return branches_within(branch_gap_squared(low, high, surface), widest)


@noinline
def _reached(
    points: Float[Array, "k 3 s"], limit: Float[Array, "k s"], bounds: Float[Array, "k 11 b"]
) -> Array:
    """Return which leaves and points `[k, BRANCH, s]` of each pair lie within the point's own limit."""
    points, bounds = points[:, :, None], bounds[..., None]
    squared, height = jnp.zeros(()), -bounds[:, 9]
    for x in range(3):
        gap = most(jnp.abs(points[:, x] - bounds[:, x]) - bounds[:, 3 + x], 0.0)
        squared = squared + gap * gap
        height = height + points[:, x] * bounds[:, 6 + x]
    gap = most(jnp.abs(height) - bounds[:, 10], 0.0)
    squared = most(squared, gap * gap)
    return (squared <= (limit * limit)[:, None]) & (limit >= 0)[:, None]


@noinline
def distance_to(
    triangle: Int[Array, " n"], points: Float[Array, "3 n"], surface: PosedSurface, tables: SurfaceTables
) -> Float[Array, " n"]:
    """Return the distance to a named triangle, a hair too large: an upper bound for the nearest one."""
    vertex = fusion_barrier(jnp.asarray(tables.faces)[triangle].T)
    corners = coordinates_of(vertex, surface.flat)
    squared = squared_distance(points, corners[..., None])[:, 0]
    return jnp.sqrt(squared) * (1 + 1e-4) + 1e-6


def distance_to_corner(
    triangle: Int[Array, " n"], points: Float[Array, "n 3"], surface: PosedSurface, tables: SurfaceTables
) -> Float[Array, " n"]:
    """Return the distance to the first corner of a named triangle: a bound at a tenth of the cost."""
    away = points.T - coordinates_of(jnp.asarray(tables.faces)[:, 0][triangle], surface.flat)
    return jnp.sqrt(squared_length(away)) * (1 + 1e-4) + 1e-6


def nearest_leaf(
    points: Float[Array, "n 3"], surface: PosedSurface, tables: SurfaceTables
) -> Int[Array, " n"]:
    """Return the row of the triangle whose corner is the nearest of one a leaf: a guess from nothing."""
    corners = coordinates_of(jnp.asarray(tables.faces)[::LEAF, 0], surface.flat)
    squared = squared_length(points.T[:, :, None] - corners[:, None])
    return LEAF * squared.argmin(axis=1).astype(jnp.int32)
