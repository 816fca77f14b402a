"""The elastic energy of a displaced garment: bending, distance, edge lengths; and steps down it.

    1/2 ||Lap(x)||^2 + hold/2 ||x||^2 + spring/2 sum over edges (|edge of P + x| - its rest length)^2

`hold` and `spring` follow from two lengths and the mesh, so that both act alike on finer meshes.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.geometry.laplacian import LaplacianTable
from garment_jax.geometry.stencil import materialised

NO_LENGTH = 1e-6  # metres: two vertices that met have a length all the same


class ElasticTables(NamedTuple):
    """What the energy needs of a mesh (static), neighbours first and vertices last: so it vectorises."""

    index: np.ndarray  # [k, n] int32 one-ring, padded with the vertex itself
    rest: np.ndarray  # [k, n] float32 metres, the template's edges; 0 where padded
    weight: np.ndarray  # [k, n] float32 of the Laplacian
    weight_back: np.ndarray  # [k, n] of its transpose
    total: np.ndarray  # [n] sum of a vertex' weights
    hold: float  # weight of the distance from the prediction, beside the Laplacian's 1
    spring: float  # weight of the edges' lengths
    lipschitz: float  # above the energy's largest curvature; that of a crushed edge is far below 0


def make_elastic_tables(
    template: Float[np.ndarray, "n 3"],
    table: LaplacianTable,
    *,
    spread: float,
    thickness: float,
) -> ElasticTables:
    """Return the tables of a garment (`template` in metres) with at least one edge.

    `spread` (metres): over which bending lets a displacement die away. `thickness` (metres): with edges so
    long, changing their length costs as much as displacing a vertex by as much. Raises `ValueError` for a
    Laplacian whose one-ring is not symmetric.
    """
    T = np.asarray(template, np.float64)
    index = np.asarray(table.index, np.int32).T
    rest = np.linalg.norm(T[index] - T[None], axis=-1)
    mean = float(rest[index != np.arange(len(T))].mean())  # every edge twice
    hold, spring = (mean / (2 * spread)) ** 4, (mean / thickness) ** 2
    ring = int((rest > 0).sum(axis=0).max())  # twice as much bounds the springs' largest eigenvalue
    back = transposed_weights(table)
    bound = lipschitz(table, back) + hold + 2 * ring * spring
    weight, back = (np.ascontiguousarray(np.asarray(w, np.float32).T) for w in (table.weight, back))
    return ElasticTables(
        np.ascontiguousarray(index),
        np.ascontiguousarray(rest, np.float32),
        weight,
        back,
        weight.sum(axis=0),
        hold,
        spring,
        bound,
    )


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


def elastic_gradient(
    x: Float[Array, "3 n"],
    P: Float[Array, "3 n"],
    L: Float[Array, "3 n"],
    tables: ElasticTables,
    longest: Float[Array, "k n"] | None = None,
) -> Float[Array, "3 n"]:
    """Return the energy's gradient at the displacement `x` from `P` with the Laplacian `L`, gathers alone.

    Edges may be as long as `longest` (metres) at no cost; their rest lengths if None.
    """
    at = P + x
    flat = materialised(at).reshape(-1)
    # Two loops over the neighbours: with one for both, XLA of jax 0.12 gives wrong numbers on a CPU inside of
    # `collision.sides` (tests/collision/test_sides.py sees it).
    r = _summed(flat, at, tables, tables.weight) - L
    bent = _summed(materialised(r).reshape(-1), r, tables, tables.weight_back)
    pulled = jnp.zeros_like(at)
    for k in range(len(tables.index)):
        e = at - _neighbour(flat, k, at, tables)
        length = jnp.sqrt(jnp.maximum(dot(e, e), NO_LENGTH**2))
        wanted = jnp.asarray(tables.rest[k])
        if longest is not None:
            wanted = jnp.clip(length, wanted, longest[k])
        pulled = pulled + (1 - wanted / length)[None] * e
    return bent + tables.hold * x + tables.spring * pulled


def edge_lengths(P: Float[Array, "3 n"], tables: ElasticTables) -> Float[Array, "k n"]:
    """Return the lengths of the edges to every vertex' neighbours, metres."""
    flat = materialised(P).reshape(-1)
    ways = (P - _neighbour(flat, k, P, tables) for k in range(len(tables.index)))
    return jnp.stack([jnp.sqrt(dot(e, e)) for e in ways])


def planes_laplacian(P: Float[Array, "3 n"], tables: ElasticTables) -> Float[Array, "3 n"]:
    """Return the Laplacian of `P`, coordinates first."""
    return _summed(materialised(P).reshape(-1), P, tables, tables.weight)


def accelerated(
    new: Float[Array, "3 n"], x: Float[Array, "3 n"], y: Float[Array, "3 n"], theta: Float[Array, ""]
) -> tuple[Array, Array, Array]:
    """Return `(x, y, theta)` after a step from the extrapolated `y` to `new`, with Nesterov's momentum.

    Momentum that points uphill is thrown away (O'Donoghue and Candes 2015).
    """
    uphill = jnp.vdot(y - new, new - x) > 0
    following = jnp.where(uphill, 1.0, (1 + jnp.sqrt(1 + 4 * theta**2)) / 2)
    beta = jnp.where(uphill, 0.0, (theta - 1) / following)
    return new, new + beta * (new - x), following


def dot(u, v) -> Array:
    """Return the scalar products of vectors with the coordinates first."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _summed(flat: Array, at: Array, tables: ElasticTables, weight: np.ndarray) -> Array:
    """Return sum_k w_ik (x_k - x_i) `[3, n]`; the transpose with `weight_back` has the same diagonal."""
    out = -jnp.asarray(tables.total)[None] * at
    for k in range(len(tables.index)):
        out = out + jnp.asarray(weight[k])[None] * _neighbour(flat, k, at, tables)
    return out


def _neighbour(flat: Array, k: int, at: Array, tables: ElasticTables) -> Array:
    n = at.shape[1]
    return jnp.stack([flat[jnp.asarray(tables.index[k]) + axis * n] for axis in range(3)])
