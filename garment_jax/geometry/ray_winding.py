"""How often a posed surface goes around points: the crossings of a ray each, counted without a tolerance.

A ray along the third axis leaves a closed surface once more than it enters it for every time that the
surface goes around where it begins. Whether it meets a triangle is told in the plane of the other two axes,
by the signs of three edges. An edge has the same sign, digit for digit, for both of its triangles: none is
met twice or missed.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt32

from garment_jax.geometry.bitset import WORD, marked_up_to, pack, select, word_bits
from garment_jax.geometry.noinline import noinline
from garment_jax.geometry.surface_search import PosedSurface
from garment_jax.geometry.surface_tables import BRANCH, LEAF, SurfaceTables

PAIRS = 128  # pairs of a point and a branch taken at a time
TESTS = 64  # pairs of a point and a leaf tested at a time


@noinline
def winding_by_ray(
    points: Float[Array, "3 k"],
    ahead: Bool[Array, " k"],
    asked: Bool[Array, " k"],
    surface: PosedSurface,
    tables: SurfaceTables,
) -> Int[Array, " k"]:
    """Return the winding numbers of the closed surface around `points`, 0 where not `asked`.

    0 outside, 1 inside, 2 where two parts cover each other, -1 in a part that is turned inside out. `points`
    are relative to `surface.origin`, metres; rays go along +z where `ahead`, else along -z, which changes
    the cost alone. Exact but within rounding of the surface (1e-6 m in float32). Not differentiable.
    """
    first = jnp.asarray(tables.once).reshape(-1, LEAF)
    words = _branches_met(points, ahead, asked, surface)
    up_to = marked_up_to(words)

    def pairs(state: tuple[Array, Array]):
        at, around = state
        point, branch, valid = select(at, PAIRS, words, up_to)
        inner = _leaves_met(points, ahead, point, branch, valid, surface)
        inner_up_to = marked_up_to(inner)

        def tests(state: tuple[Array, Array]):
            at, around = state
            pair, place, valid = select(at, TESTS, inner, inner_up_to)
            which, leaf = point[pair], branch[pair] * BRANCH + place
            count = _crossings(points, ahead, which, leaf, surface, first)
            return at + TESTS, _added(around, which, count, valid)

        return at + PAIRS, jax.lax.while_loop(
            lambda s: s[0] < inner_up_to[-1], tests, (jnp.int32(0), around)
        )[1]

    start = jnp.int32(0), jnp.zeros(points.shape[1], jnp.int32)
    return jax.lax.while_loop(lambda s: s[0] < up_to[-1], pairs, start)[1]


@noinline
def _branches_met(
    points: Float[Array, "3 k"], ahead: Bool[Array, " k"], asked: Bool[Array, " k"], surface: PosedSurface
) -> UInt32[Array, "k w"]:
    """Return the marks of the branches whose boxes a point's ray meets."""
    low, high = _full_words(surface)
    p = points[:, None]  # the points last: what is summed over the last axis takes five times as long
    met = asked[None] & (low[0] <= p[0]) & (p[0] <= high[0]) & (low[1] <= p[1]) & (p[1] <= high[1])
    met = met & jnp.where(ahead[None], p[2] <= high[2], low[2] <= p[2])
    met = met.reshape(-1, WORD, met.shape[1])
    return jnp.where(met, word_bits()[None, :, None], jnp.uint32(0)).sum(axis=1, dtype=jnp.uint32).T


@noinline
def _full_words(surface: PosedSurface) -> tuple[Array, Array]:
    """Return the branches' least and greatest coordinates `[3, w, 1]`; no ray meets those that fill up."""
    fill = ((0, 0), (0, -surface.low.shape[1] % WORD))
    low, high = jnp.pad(surface.low, fill, constant_values=jnp.inf), jnp.pad(surface.high, fill)
    return low[..., None], high[..., None]


@noinline
def _leaves_met(
    points: Float[Array, "3 k"],
    ahead: Bool[Array, " k"],
    point: Int[Array, " p"],
    branch: Int[Array, " p"],
    valid: Bool[Array, " p"],
    surface: PosedSurface,
):
    """Return the marks of each pair's leaves whose boxes the ray meets."""
    bounds, p = surface.bounds[branch], points[:, point, None]
    beside = (jnp.abs(p[x] - bounds[:, x]) <= bounds[:, 3 + x] * (1 + 1e-5) + 1e-6 for x in range(2))
    along = jnp.where(ahead[point, None], bounds[:, 2] - p[2], p[2] - bounds[:, 2])
    met = valid[:, None] & (along + bounds[:, 5] * (1 + 1e-5) + 1e-6 >= 0)
    for side in beside:
        met = met & side
    return pack(met)


@noinline
def _crossings(
    points: Float[Array, "3 k"],
    ahead: Bool[Array, " k"],
    which: Int[Array, " t"],
    leaf: Int[Array, " t"],
    surface: PosedSurface,
    first: Bool[Array, "l s"],
) -> Int[Array, " t"]:
    """Return through how many of its leaf's triangles each test's ray leaves, less those it enters by."""
    rows = surface.corners[leaf].reshape(-1, 3, 3, LEAF)
    x, y, z = (
        [rows[:, axis, corner] - points[axis, which, None] for corner in range(3)] for axis in range(3)
    )
    sides, values = zip(*(_edge(x[i], y[i], x[j], y[j]) for i, j in ((1, 2), (2, 0), (0, 1))), strict=True)
    left = sides[0] & sides[1] & sides[2]  # of all three edges: the triangle faces along +z
    right = ~(sides[0] | sides[1] | sides[2])
    beyond = z[0] * values[0] + z[1] * values[1] + z[2] * values[2]  # six volumes: where the ray meets it
    up = ahead[which, None]
    met = jnp.where(up == left, beyond > 0, beyond < 0) & (left | right) & first[leaf]
    return jnp.where(met, jnp.where(up == left, 1, -1), 0).sum(axis=1)


def _edge(x: Array, y: Array, u: Array, v: Array) -> tuple[Array, Array]:
    """Return on which side of an edge from (x, y) to (u, v) the origin is, and twice their triangle's area.

    The ends are taken in one order whichever way the edge goes, for a product rounds differently in another.
    """
    turned = (x > u) | ((x == u) & (y > v))
    a, b, c, d = (
        jnp.where(turned, u, x),
        jnp.where(turned, v, y),
        jnp.where(turned, x, u),
        jnp.where(turned, y, v),
    )
    value = a * d - b * c
    return (value > 0) != turned, jnp.where(turned, -value, value)


@noinline
def _added(
    around: Int[Array, " k"], which: Int[Array, " t"], count: Int[Array, " t"], valid: Bool[Array, " t"]
) -> Int[Array, " k"]:
    return around.at[jnp.where(valid, which, len(around))].add(count, mode="drop")
