"""The elastic energy of a displaced garment: bending, distance, edge lengths; and steps down it.

    1/2 ||Lap(x)||^2 + hold/2 ||x||^2 + spring/2 sum over edges (|edge of P + x| - its rest length)^2

`hold` and `spring` follow from two lengths and the mesh, so that both act alike on finer meshes. An edge of
less than 1 / `crushed` of its length pushes in proportion to what is left of it.
"""

import math
from collections.abc import Iterator
from itertools import combinations, pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped

from garment_jax.geometry.laplacian import LaplacianTable
from garment_jax.geometry.noinline import noinline
from garment_jax.geometry.triangle import dot

NO_LENGTH = 1e-6  # metres: two vertices that met have a length all the same
GOLDEN = (1 + math.sqrt(5)) / 2  # what follows 1 in Nesterov's sequence
BAND = 500  # gathered neighbours that another band's operations cost as much as


class Band(NamedTuple):
    """`m` vertices with about as many neighbours, these first and vertices last: so it vectorises."""

    index: np.ndarray  # [k, m] int32 places of the one-ring in the tables' order, padded with the own one
    rest: np.ndarray  # [k, m] float32 metres, the template's edges; 0 where padded
    weight: np.ndarray  # [k, m] float32 of the Laplacian
    weight_back: np.ndarray  # [k, m] of its transpose
    total: np.ndarray  # [m] sum of a vertex' weights


class ElasticTables(NamedTuple):
    """What the energy needs of a mesh (static); all else here is in its order of the vertices.

    Those with most neighbours come first, in bands: less padding is gathered, a third of the time.
    """

    order: np.ndarray  # [n] int32 vertices
    place: np.ndarray  # [n] int32 where a vertex is in it
    bands: tuple[Band, ...]  # one after the other, all vertices
    hold: float  # weight of the distance from the prediction, beside the Laplacian's 1
    spring: float  # weight of the edges' lengths
    crushed: float  # how many times its length an edge may want to have: beyond, it pushes for no more
    lipschitz: float  # above the energy's largest curvature


Edges = tuple[jax.Array, ...]  # of each band, [3, k, m]


def make_elastic_tables(
    template: Float[np.ndarray, "n 3"],
    table: LaplacianTable,
    *,
    spread: float,
    thickness: float,
    crushed: float = math.inf,
) -> ElasticTables:
    """Return the tables of a garment (`template` in metres) with at least one edge.

    `spread` (metres): over which bending lets a displacement die away. `thickness` (metres): with edges so
    long, changing their length costs as much as displacing a vertex by as much. `crushed`: an edge
    shorter than 1 / `crushed` of its length pushes the less the shorter it is. Raises `ValueError` for a
    Laplacian whose one-ring is not symmetric.
    """
    T = np.asarray(template, np.float64)
    own, index = np.arange(len(T)), np.asarray(table.index, np.int32).T
    count = (index != own).sum(axis=0)
    first = np.argsort(index == own, axis=0, kind="stable")  # padding last
    order = np.argsort(-count, kind="stable").astype(np.int32)
    place = np.argsort(order).astype(np.int32)
    rest = np.linalg.norm(T[index] - T[None], axis=-1)
    mean = float(rest[index != own].mean())  # every edge twice
    hold, spring = (mean / (2 * spread)) ** 4, (mean / thickness) ** 2
    back = transposed_weights(table)
    # twice as many springs as a vertex has at most bound their largest eigenvalue
    bound = lipschitz(table, back) + hold + 2 * int((rest > 0).sum(axis=0).max()) * spring
    columns = (place[index], rest, np.asarray(table.weight).T, back.T)
    columns = [np.take_along_axis(x, first, axis=0)[:, order] for x in columns]
    ends = [*band_ends(count[order]), len(T)]
    bands = (_band(columns, slice(a, b), int(count[order[a]])) for a, b in pairwise(ends))
    return ElasticTables(order, place, tuple(bands), hold, spring, crushed, bound)


def band_ends(count: Int[np.ndarray, " n"]) -> list[int]:
    """Return where bands of vertices with `count` neighbours (falling) begin: at most three."""
    starts = 1 + np.flatnonzero(np.diff(count))

    def cost(cuts: tuple[int, ...]) -> int:
        return sum(int(count[a]) * (b - a) + BAND for a, b in pairwise([*cuts, len(count)]))

    found = ((0, *cuts) for k in range(3) for cuts in combinations(starts.tolist(), k))
    return list(min(found, key=cost))


def _band(columns: list[np.ndarray], own: slice, width: int) -> Band:
    index, *rest = (x[:width, own] for x in columns)
    rest, weight, back = (np.ascontiguousarray(x, np.float32) for x in rest)
    return Band(np.ascontiguousarray(index, np.int32), rest, weight, back, weight.sum(axis=0))


def ordered(P: Shaped[Array, "*b n"], tables: ElasticTables) -> Shaped[Array, "*b n"]:
    """Return what vertices have, in the tables' order."""
    return P[..., jnp.asarray(tables.order)]


def disordered(P: Shaped[Array, "*b n"], tables: ElasticTables) -> Shaped[Array, "*b n"]:
    """Return what is in the tables' order, in the mesh's."""
    return P[..., jnp.asarray(tables.place)]


def transposed_weights(table: LaplacianTable) -> np.ndarray:
    """Return `[n, k]` weights w_ji at the slots of w_ij, so that the transpose is a gather too.

    Raises `ValueError` when the one-ring is not symmetric.
    """
    n, k = table.index.shape
    row = np.repeat(np.arange(n), k)
    column = np.asarray(table.index, np.int64).reshape(-1)  # int32 squared overflows beyond 46,340 vertices
    real = row != column
    forward, backward = row * n + column, column * n + row
    order = np.argsort(forward[real])
    sorted_codes = forward[real][order]
    place = np.searchsorted(sorted_codes, backward[real])
    if not np.array_equal(sorted_codes[np.minimum(place, len(order) - 1)], backward[real]):
        raise ValueError(
            "the Laplacian's one-ring is not symmetric; build it with uniform_table or cotangent_table."
        )
    back = np.zeros(n * k, np.float32)
    back[real] = np.asarray(table.weight).reshape(-1)[real][order[place]]
    return back.reshape(n, k)


def lipschitz(table: LaplacianTable, back: np.ndarray, *, steps: int = 60) -> float:
    """Return an upper estimate of the largest eigenvalue of Lap^T Lap, by power iteration.

    A few per cent are added, since the iteration comes from below and a step that is too long
    diverges while one that is too short is only slow.
    """
    x = np.random.default_rng(0).normal(size=len(table.index))
    total = table.weight.sum(axis=1)
    value = 0.0
    for _ in range(steps):
        r = (table.weight * x[table.index]).sum(axis=1) - total * x
        x = (back * r[table.index]).sum(axis=1) - total * r
        value = float(np.linalg.norm(x))
        if value == 0.0:
            return 1.0  # no edges at all: nothing resists, and any step is right
        x /= value
    return 1.05 * value


def elastic_gradient(x: Float[Array, "3 n"], edges: Edges, tables: ElasticTables) -> Float[Array, "3 n"]:
    """Return the energy's gradient at the displacement `x` (metres) of a mesh with `edges` (`edges_of`)."""
    around = _neighbours(x, tables)  # gathered once for both
    r = _laplacian(around, x, tables, [band.weight for band in tables.bands])
    bent = _laplacian(_neighbours(r, tables), r, tables, [band.weight_back for band in tables.bands])
    pulled = [
        _pull(own, edges[b], around[b], band, tables.crushed) for b, (band, own) in enumerate(_own(x, tables))
    ]
    return _together(bent, x, pulled, tables)


@noinline
def _pull(
    own: Float[Array, "3 m"],
    edges: Float[Array, "3 k m"],
    around: Float[Array, "3 k m"],
    band: Band,
    crushed: float,
) -> Float[Array, "3 m"]:
    """Return the gradient of one band's stretching, per unit of `spring`."""
    pull = jnp.zeros_like(own)
    for k in range(len(band.index)):
        e = edges[:, k] + own - around[:, k]
        length = jnp.sqrt(jnp.maximum(dot(e, e), NO_LENGTH**2))
        pull = pull + jnp.maximum(1 - jnp.asarray(band.rest[k]) / length, 1 - crushed)[None] * e
    return pull


@noinline
def _together(
    bent: Float[Array, "3 n"], x: Float[Array, "3 n"], pulled: list[Array], tables: ElasticTables
) -> Array:
    return bent + tables.hold * x + tables.spring * jnp.concatenate(pulled, axis=1)


def edges_of(P: Float[Array, "3 n"], tables: ElasticTables) -> Edges:
    """Return the ways from every vertex' neighbours to it, metres; 0 where padded."""
    pairs = zip(_own(P, tables), _neighbours(P, tables), strict=True)
    return tuple(own[:, None] - around for (_, own), around in pairs)


@noinline
def accelerated(
    new: Float[Array, "3 n"],
    x: Float[Array, "3 n"],
    y: Float[Array, "3 n"],
    theta: Float[Array, ""],
    *,
    restart: float = 1.0,
) -> tuple[Array, Array]:
    """Return `(y, theta)` after a step from `x`, extrapolated to `y`, to `new`, with Nesterov's momentum.

    Momentum that points uphill is thrown away (O'Donoghue and Candes 2015), and `restart` is theta: from 1
    the next step has none either, from `GOLDEN` it has.
    """
    uphill = dot(y - new, new - x).sum() > 0  # `vdot` takes six times as long
    following = jnp.where(uphill, restart, (1 + jnp.sqrt(1 + 4 * theta**2)) / 2)
    beta = jnp.where(uphill, 0.0, (theta - 1) / following)
    return new + beta * (new - x), following


@noinline
def _laplacian(around: Edges, x: Array, tables: ElasticTables, weight: list[np.ndarray]) -> Array:
    """Return sum_k w_ik (x_k - x_i) `[3, n]`; the transpose has other weights and the same diagonal.

    Not `stencil`: `around` has been gathered for the edges' lengths already.
    """
    sums = []
    for (band, own), near, w in zip(_own(x, tables), around, weight, strict=True):
        out = -jnp.asarray(band.total)[None] * own
        for k in range(len(w)):
            out = out + jnp.asarray(w[k])[None] * near[:, k]
        sums.append(out)
    return jnp.concatenate(sums, axis=1)


def _own(x: Array, tables: ElasticTables) -> Iterator[tuple[Band, Array]]:
    """Yield every band with its part `[3, m]` of `x`."""
    start = 0
    for band in tables.bands:
        yield band, x[:, start : start + len(band.total)]
        start += len(band.total)


@noinline
def _neighbours(x: Array, tables: ElasticTables) -> Edges:
    """Return the neighbours `[3, k, m]` in every band; a gather for each of them takes longer."""
    flat = x.reshape(-1)
    planes = x.shape[1] * np.arange(3, dtype=np.int32)[:, None, None]
    places = (jnp.asarray(band.index[None] + planes) for band in tables.bands)
    return tuple(flat.at[p].get(mode="promise_in_bounds", wrap_negative_indices=False) for p in places)
