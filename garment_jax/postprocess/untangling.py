"""Undo self-crossings: a fold that lies in itself is flattened until it does not.

A network that predicts the mean of folds it cannot know has them pass through each other. Smoothed over four
to eight centimetres around a crossing, cloth has none left, and is no farther from the truth. So every vertex
has a weight of smoothing. It grows around what still crosses, pass by pass, and fades from frame to frame, so
that a fold neither opens nor closes at once. A frame without crossings, after others without, comes back as
it is. Not in the paper, whose stated limit it is.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from garment_jax.geometry.boundary import boundary_edges
from garment_jax.geometry.gather import coordinates_of
from garment_jax.geometry.noinline import noinline
from garment_jax.geometry.self_crossings import (
    CrossingTables,
    Found,
    find_self_crossings,
    make_crossing_tables,
)
from garment_jax.geometry.topology import neighbour_table

REACH = 0.07  # metres over which a vertex of full weight is smoothed
PASSES = 16  # of smoothing and looking in a frame
GROWTH = 0.15  # of a weight of at most 1, where a pass still finds a crossing
FADE = 0.9  # of the last frame's weights
GONE = 1e-3  # weight that counts as none
AROUND = 0.85  # of the growth at a vertex, for its neighbours
RINGS = 8  # neighbours of neighbours that grow with it


class UntangleTables(NamedTuple):
    """What does not change from frame to frame (static)."""

    crossings: CrossingTables
    ring: np.ndarray  # [k, n] int32 neighbours, padded with the vertex itself
    mean: np.ndarray  # [k, n] float32 weights of their mean; on a border of those on it
    free: np.ndarray  # [n] float32, 0 at pins
    steps: int  # of smoothing


class UntangleState(NamedTuple):
    """What one frame hands to the next."""

    weight: jax.Array  # [n] 0 to 1, of smoothing


def make_untangle_tables(
    template: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], pins: Int[np.ndarray, " p"]
) -> UntangleTables:
    """Return the tables of a garment with at least one face (`template` in metres)."""
    n = len(template)
    index, mask = neighbour_table(faces, n)
    edges = boundary_edges(faces)
    along = np.zeros(n, bool)
    along[edges.ravel()] = True
    both = {(int(a), int(b)) for a, b in edges} | {(int(b), int(a)) for a, b in edges}
    keep = mask > 0
    for i in np.flatnonzero(along):
        keep[i] &= [(int(i), int(j)) in both for j in index[i]]
    weight = keep / np.maximum(keep.sum(axis=1, keepdims=True), 1)
    T = np.asarray(template, np.float64)
    way = np.linalg.norm(T[index] - T[:, None], axis=-1)
    length = float(way[mask > 0].mean()) if (mask > 0).any() else 1.0
    # half a step towards the mean of neighbours at `length` has a variance of length^2 / 2, two ways of it
    steps = int(np.clip(np.ceil(4 * (REACH / length) ** 2), 1, 200))
    free = np.ones(n, np.float32)
    free[pins] = 0
    return UntangleTables(
        make_crossing_tables(template, faces),
        np.ascontiguousarray(index.T, np.int32),
        np.ascontiguousarray(weight.T, np.float32),
        free,
        steps,
    )


def init_untangle(n: int) -> UntangleState:
    """Return the state before the first frame of a garment of `n` vertices."""
    return UntangleState(jnp.zeros(n))


def faded(state: UntangleState) -> UntangleState:
    """Return the weights that a frame begins with."""
    weight = FADE * state.weight
    return UntangleState(jnp.where(weight < GONE, 0.0, weight))


def untangle(
    state: UntangleState, V: Float[Array, "n 3"], tables: UntangleTables
) -> tuple[UntangleState, Float[Array, "n 3"], Int[Array, ""]]:
    """Return the weights, `V` (metres) smoothed by them, and how many edges still go through a face.

    Where nothing crosses and all weights are 0, `V` comes back bitwise. Pins stay. A frame with a NaN comes
    back as it is.
    """

    def attempt(carry: tuple[Array, ...]) -> tuple[Array, ...]:
        weight, _, _, passes = carry
        x = jax.lax.cond(weight.any(), lambda: _smoothed(V, weight, tables), lambda: V)
        found = find_self_crossings(x, tables.crossings)
        weight = jax.lax.cond(
            (found.edges > 0) & (passes + 1 < PASSES), lambda: _grown(weight, found, tables), lambda: weight
        )
        return weight, x, found.edges, passes + 1

    start = (state.weight, V, jnp.int32(1), jnp.int32(0))
    weight, x, left, _ = jax.lax.while_loop(lambda c: (c[2] > 0) & (c[3] < PASSES), attempt, start)
    finite = jnp.isfinite(V).all()
    return UntangleState(jnp.where(finite, weight, 0.0)), jnp.where(finite, x, V), left


def grown(
    state: UntangleState, V: Float[Array, "n 3"], tables: UntangleTables
) -> tuple[UntangleState, Array]:
    """Return the weights, grown around what crosses in `V`, and how many edges do."""
    found = find_self_crossings(V, tables.crossings)
    weight = jax.lax.cond(found.edges > 0, lambda: _grown(state.weight, found, tables), lambda: state.weight)
    return UntangleState(weight), found.edges


def _smoothed(V: Array, weight: Array, tables: UntangleTables) -> Array:
    half = 0.5 * weight * jnp.asarray(tables.free)

    def step(_: Array, P: Array) -> Array:
        return _towards(P, half, coordinates_of(tables.ring, P.reshape(-1)), tables.mean)

    return jax.lax.fori_loop(0, tables.steps, step, V.T).T


@noinline
def _towards(P: Array, half: Array, around: Float[Array, "3 k n"], mean: np.ndarray) -> Array:
    total = jnp.zeros_like(P)
    for k in range(len(mean)):
        total = total + jnp.asarray(mean[k])[None] * around[:, k]
    return P + half[None] * (total - P)


def _grown(weight: Array, found: Found, tables: UntangleTables) -> Array:
    def spread(_: Array, b: Array) -> Array:
        return jnp.maximum(b, AROUND * b[jnp.asarray(tables.ring)].max(axis=0))

    grown = jax.lax.fori_loop(0, RINGS, spread, found.vertices.astype(weight.dtype))
    return jnp.minimum(weight + GROWTH * grown, 1.0)
