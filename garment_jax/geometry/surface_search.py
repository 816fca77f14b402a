"""The search behind `closest_point`: which triangle of a posed mesh is nearest to each point.

Work lists in place of recursion: pairs of a group of points and a bounding sphere, compacted to a
static size, so that the cost follows the number of pairs that can matter.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from garment_jax.geometry.surface_tables import BRANCH, LEAF, SurfaceTables
from garment_jax.geometry.triangle import closest_on_triangle, triangle_rows


class PosedSurface(NamedTuple):
    """One frame's mesh, ready to be searched several times."""

    vertices: jax.Array  # [c, 3] relative to origin
    origin: jax.Array  # [3] taken off all coordinates, for float32's digits far from zero
    rows: tuple[jax.Array, ...]  # `triangle_rows`, 22 of [l, 8]
    leaf_centre: jax.Array  # [l, 3]
    leaf_radius: jax.Array  # [l]
    branch_centre: jax.Array  # [l / 16, 3]
    branch_radius: jax.Array  # [l / 16]


class Budget(NamedTuple):
    """Room in the search's work lists (static); what does not fit is searched by brute force."""

    branches: int = 2048  # pairs of a group of points and a branch
    leaves: int = 4096  # pairs of a group of points and a leaf
    chunk: int = 512  # pairs tested at a time

    def single(self) -> "Budget":
        """Return the room for groups of one point: all of them are searched, however far away."""
        return Budget(2 * self.branches, 2 * self.leaves, self.chunk)


class Nearest(NamedTuple):
    """The answer of a search over `n` points."""

    triangle: jax.Array  # [n] int32 row of the tables' faces, -1 where nothing lay within the bound
    distance: jax.Array  # [n] metres, or the bound itself
    fits: jax.Array  # [] bool: the work lists sufficed; if not, the answer may be wrong


def pose_surface(vertices: Float[Array, "c 3"], tables: SurfaceTables) -> PosedSurface:
    """Return the searchable form of the mesh at `vertices` (any frame, metres)."""
    vertices = jnp.asarray(vertices)
    origin = vertices.mean(axis=0)
    vertices = vertices - origin[None]
    corners = vertices[jnp.asarray(tables.faces)]  # [r, corner, xyz]
    low = corners.min(axis=1).reshape(-1, LEAF, 3).min(axis=1)
    high = corners.max(axis=1).reshape(-1, LEAF, 3).max(axis=1)
    centre, radius = _ball(low, high)
    low, high = low.reshape(-1, BRANCH, 3).min(axis=1), high.reshape(-1, BRANCH, 3).max(axis=1)
    rows = tuple(x.reshape(-1, LEAF) for x in rows_of(tables.faces, vertices))
    return PosedSurface(vertices, origin, rows, centre, radius, *_ball(low, high))


def _ball(low: Array, high: Array) -> tuple[Array, Array]:
    """Return centre `[k, 3]` and radius `[k]` of the balls around boxes, a hair too large."""
    half = (high - low) / 2
    return (low + high) / 2, jnp.sqrt((half * half).sum(axis=-1)) * (1 + 1e-5)


def rows_of(corners: Int[Array | np.ndarray, "k 3"], vertices: Float[Array, "c 3"]) -> tuple[Array, ...]:
    """Return `triangle_rows`, 22 arrays `[k]`, of the triangles with these corners."""
    # Coordinates stay separate arrays: stacking them makes XLA on CPU compute everything three times.
    at = vertices[jnp.asarray(corners)]
    a, b, c = (tuple(at[:, k, x] for x in range(3)) for k in range(3))
    ab, ac = (tuple(x - y for x, y in zip(e, a, strict=True)) for e in (b, c))
    return tuple(triangle_rows(a, ab, ac))


def stored(x):
    """Return the arrays `x`, computed once.

    XLA on CPU fuses cheap arithmetic into every consumer and so repeats it, for a row of three or a
    gather of eight many times over (it drops optimisation barriers first). It cannot look through
    a condition that it cannot decide.
    """
    first = jax.tree.leaves(x)[0].reshape(-1)[0]
    return jax.lax.cond(first == first, lambda y: y, lambda y: jax.tree.map(lambda z: z + z, y), x)


def search_all(points: Float[Array, "n 3"], surface: PosedSurface) -> Int[Array, " n"]:
    """Return the nearest triangle of every point by testing all of them, leaf after leaf."""
    p = tuple(points[None, :, x] for x in range(3))

    def leaf(i, best):
        squared = closest_on_triangle(p, tuple(x[i][:, None] for x in surface.rows))[2]  # [8, n]
        key = _key(squared, jnp.arange(LEAF, dtype=jnp.int32)[:, None]).min(axis=0)
        nearer = key < best[0]
        return jnp.where(nearer, key, best[0]), jnp.where(nearer, i, best[1])

    n = len(points)
    start = (jnp.full(n, jnp.iinfo(jnp.int32).max, jnp.int32), jnp.zeros(n, jnp.int32))
    key, where = jax.lax.fori_loop(0, len(surface.leaf_radius), leaf, start)
    return where * LEAF + (key & (LEAF - 1))


def search_groups(
    points: Float[Array, "g s 3"],
    bound: Float[Array, "g s"],
    wanted: Bool[Array, " g"],
    surface: PosedSurface,
    budget: Budget,
) -> Nearest:
    """Return the nearest triangle `[g, s]` of each point of the wanted groups within its `bound`."""
    points, bound = stored((points, bound))
    group, leaf, count, fits = _pairs(points, jnp.where(wanted[:, None], bound, -1.0), surface, budget)
    key, where = _visit(group, leaf, count, points, bound, surface, budget)
    triangle = jnp.where(where < 0, -1, where * LEAF + (key & (LEAF - 1)))
    squared = jax.lax.bitcast_convert_type(key & ~(LEAF - 1), jnp.float32)
    return Nearest(triangle, jnp.sqrt(squared), fits)


def _key(squared: Array, slots: Array | int) -> Array:
    """Return integers ordered like `squared` (>= 0) with the slot in the three lowest bits.

    An integer minimum vectorises where an arg-minimum does not; the price is 2^-20 of the square.
    """
    bits = jax.lax.bitcast_convert_type(squared.astype(jnp.float32), jnp.int32)
    return (bits & ~(LEAF - 1)) | slots


def _within(points, bound, centre, radius):
    """Return whether points (x, y, z) are nearer to balls than their bound; never if it is negative."""
    squared = sum((p - c) ** 2 for p, c in zip(points, centre, strict=True))
    room = bound + radius
    return (squared < room * room) & (bound >= 0)


def _pairs(points, bound, surface, budget):
    """Return the pairs of groups and leaves that may hold a closest point, by way of the branches.

    A ball is tested against each point of a group: against the group's own ball it would pass
    twice as often.
    """
    b = len(surface.branch_radius)
    p = tuple(points[:, None, :, x] for x in range(3))  # [g, 1, s]
    centre = tuple(surface.branch_centre[None, :, x, None] for x in range(3))
    near = _within(p, bound[:, None], centre, surface.branch_radius[None, :, None]).any(axis=-1)
    pair, branches = _compact(near, budget.branches)
    group, branch = pair // b, pair % b
    leaf = branch[:, None] * BRANCH + jnp.arange(BRANCH, dtype=jnp.int32)[None]
    centre = tuple(surface.leaf_centre[:, x].reshape(-1, BRANCH)[branch] for x in range(3))
    radius = surface.leaf_radius.reshape(-1, BRANCH)[branch]
    q = tuple(points[group, None, :, x] for x in range(3))  # [branches, 1, s]
    around = tuple(x[..., None] for x in centre)
    near = _within(q, bound[group, None], around, radius[..., None]).any(axis=-1)
    near = near & (jnp.arange(budget.branches) < branches)[:, None]
    pair, count = _compact(near, budget.leaves)
    fits = (branches <= budget.branches) & (count <= budget.leaves)
    return group[pair // BRANCH], leaf.reshape(-1)[pair], jnp.minimum(count, budget.leaves), fits


def _compact(mask: Array, size: int) -> tuple[Array, Array]:
    """Return the flat indices `[size]` where `mask` holds (padded with 0) and their true number."""
    flat = mask.reshape(-1)
    rank = jnp.cumsum(flat.astype(jnp.int32))
    slot = jnp.where(flat, rank - 1, size)
    index = jnp.zeros(size, jnp.int32).at[slot].set(jnp.arange(len(flat), dtype=jnp.int32), mode="drop")
    return index, rank[-1]


def _visit(group, leaf, count, points, bound, surface, budget):
    """Return the best `(key, leaf)` `[g, s]` after testing `count` pairs, a chunk at a time."""
    slots, chunk, s = jnp.arange(LEAF, dtype=jnp.int32), budget.chunk, points.shape[1]

    def step(state):
        i, best, where = state
        at = i + jnp.arange(chunk, dtype=jnp.int32)
        valid = at < count
        g, k = (x[jnp.minimum(at, len(x) - 1)] for x in (group, leaf))
        rows = tuple(x[k][:, None] for x in surface.rows)  # [chunk, 1, 8]
        q = tuple(points[g, :, x, None] for x in range(3))  # [chunk, s, 1]
        key = _key(closest_on_triangle(q, rows)[2], slots[None, None]).min(axis=-1)  # [chunk, s]
        best = best.at[jnp.where(valid, g, len(best))].min(key, mode="drop")
        won = (best[g] == key) & valid[:, None]
        target = jnp.where(won, g[:, None] * s + jnp.arange(s, dtype=jnp.int32)[None], where.size)
        where = where.at[target].set(jnp.broadcast_to(k[:, None], target.shape), mode="drop")
        return i + chunk, best, where

    start = (jnp.int32(0), _key(bound * bound, LEAF - 1), jnp.full(bound.size, -1, jnp.int32))
    _, key, where = jax.lax.while_loop(lambda state: state[0] < count, step, start)
    return key, where.reshape(bound.shape)
