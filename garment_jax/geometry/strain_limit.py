"""A garment kept from stretching where the networks let it: edges held near their length.

Not in the paper. Cloth does not stretch, and nothing in the networks forbids it. The few worst edges of a
frame are shortened by projection (position-based dynamics: Mueller et al. 2007, with Jacobi iterations
averaged over a vertex' constraints, and momentum from one to the next as in Wang 2015). As attachment it
comes after the networks and is not fed back; limb crossings and collision handling come after it, and call it
again where they have stretched the cloth themselves. Edges that are too short are left alone: they are folds
that the networks blur, and pushing them apart by projection gave a sawtooth at waist and hem (`edge_lengths`
bends them apart).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.geometry.topology import neighbour_table
from garment_jax.structs import Garment

STRETCH = 0.28  # of its rest length: what an edge may be longer
SHARE = 0.005  # of the edges that may be longer still; at twice that all is done: the 99th percentile
TARGET = 0.25  # stretch that edges are brought back to
SOFT = 0.02  # of the rest length: an edge this much above a bound counts whole, nearer to it in part; 30 %
ITERATIONS = 100  # at most; most frames need none. At 40 fast motion kept 34 % instead of 28
MOMENTUM = 0.9  # for contacts, whose frames jump anyway: a third of the iterations, but lengths overshoot
STILL = 2e-5  # metres: an iteration that moves every vertex less ends it
NO_LENGTH = 1e-9  # metres: two vertices that met have a length all the same, and no way apart


class StrainTables(NamedTuple):
    """Every edge from both its ends, and once (static)."""

    index: np.ndarray  # [k, n] int32 neighbours of each vertex, padded with itself
    rest: np.ndarray  # [k, n] float32 metres; 1 where there is no edge
    mask: np.ndarray  # [k, n] float32, 1 for an edge with a length
    share: np.ndarray  # [k, n] float32 part of the correction that this end takes: 0 at a pin, 1 beside one
    ends: np.ndarray  # [2, e] int32 vertices of the edges that have a length
    length: np.ndarray  # [e] float32 metres, at rest


def make_strain_tables(garment: Garment, pins: np.ndarray) -> StrainTables:
    """Return the tables of a garment whose vertices `pins` `[p]` stay; edges without a length are none."""
    T = garment.template.astype(np.float64)
    ring = neighbour_table(garment.faces, len(T))
    rest = np.linalg.norm(T[ring.index] - T[:, None], axis=-1)
    mask = np.where(rest > 0, ring.mask, 0.0)
    free = np.ones(len(T))
    free[pins] = 0.0
    share = mask * free[:, None] / np.maximum(free[:, None] + free[ring.index], 1.0)
    vertex, k = np.nonzero((mask > 0) & (ring.index > np.arange(len(T))[:, None]))

    def rows(x: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(x.T, np.float32)

    return StrainTables(
        np.ascontiguousarray(ring.index.T),
        rows(np.where(mask > 0, rest, 1.0)),
        rows(mask),
        rows(share),
        np.stack([vertex, ring.index[vertex, k]]).astype(np.int32),
        rest[vertex, k].astype(np.float32),
    )


def strain_limited(
    V: Float[Array, "n 3"],
    tables: StrainTables,
    *,
    as_in: Float[Array, "n 3"] | None = None,
    project: Callable[[jax.Array], jax.Array] | None = None,
    iterations: int | None = None,
    momentum: float = 0.0,
) -> tuple[Float[Array, "n 3"], jax.Array]:
    """Return `V` with fewer edges longer by more than `STRETCH` than twice `SHARE`, and the iterations taken.

    A frame that has fewer than `SHARE` comes back bitwise, as does one with a NaN; between the two the
    correction sets in gradually, so that a garment that stretches slowly does not jump. Where pins pull the
    cloth apart the iterations may end before; what is left is then spread out. With `as_in` (metres) no edge
    need be shorter, nor fewer be long, than in that frame. `project` is applied to `[3, n]` after every
    iteration, to keep what must hold besides; `iterations` at most, of themselves `ITERATIONS`. Each goes on
    by `momentum` of the last one's way (0 to below 1).
    """
    x, longest, rate = V.T, (1 + TARGET) * tables.rest, limit_rate(V, tables, as_in=as_in)
    if as_in is not None:
        longest = jnp.maximum(longest, _edges(as_in.T, tables)[1])
    wanted = jnp.where(jnp.isfinite(V).all(), jnp.clip(rate, 0.0, 1.0), 0.0)

    most = ITERATIONS if iterations is None else iterations
    # the largest without swinging up: both ends correct an edge, by up to twice its excess
    size = (1 + momentum) / (1 + 2 * momentum)

    def moving(state):
        _, _, moved, steps = state
        return (wanted > 0) & (moved > STILL) & (steps < most)

    def step(state):
        x, y, _, steps = state
        new = y + size * _correction(y, longest, tables)
        new = new if project is None else project(new)
        return new, new + momentum * (new - x), jnp.abs(new - x).max(), steps + 1

    shortened, _, _, steps = jax.lax.while_loop(moving, step, (x, x, jnp.float32(jnp.inf), jnp.int32(0)))
    return jnp.where(steps > 0, (x + wanted * (shortened - x)).T, V), steps


def limit_rate(
    V: Float[Array, "n 3"], tables: StrainTables, *, as_in: Float[Array, "n 3"] | None = None
) -> Float[Array, ""]:
    """Return how much of the limit a frame calls for: 0 or less for nothing, 1 or more for all of it."""
    share = SHARE * max(len(tables.length), 1)
    rate = _too_long(V.T, tables) / share - 1.0
    if as_in is None:
        return rate
    # most frames need nothing, and then what they are compared with need not be looked at
    spare = jax.lax.cond(rate > 0, lambda: _too_long(as_in.T, tables) / share - 1.0, lambda: 0 * rate)
    return rate - jnp.maximum(spare, 0.0)


def _correction(x: jax.Array, longest: jax.Array | np.ndarray, tables: StrainTables) -> jax.Array:
    """Return how far each vertex moves `[3, n]` in one iteration: the average over its long edges."""
    way, length = _edges(x, tables)
    over = jnp.maximum(length - longest, 0.0) * tables.mask
    # counted by degrees: an edge that just enters would halve its neighbours' corrections at once
    counted = jnp.minimum(over / (SOFT * tables.rest), 1.0)
    among = jnp.maximum((tables.share * counted).sum(axis=0), 1.0)
    return jnp.sum((tables.share * over / length)[None] * way, axis=1) / among[None]


def _too_long(x: jax.Array, tables: StrainTables) -> jax.Array:
    """Return how many edges are too long, those that hardly are in part."""
    at = jnp.take(x, jnp.asarray(tables.ends), axis=1, mode="clip")
    way = at[:, 1] - at[:, 0]
    over = (jnp.sqrt((way * way).sum(axis=0)) / tables.length - (1 + STRETCH)) / SOFT
    return jnp.clip(over, 0.0, 1.0).sum()


def _edges(x: jax.Array, tables: StrainTables) -> tuple[jax.Array, jax.Array]:
    """Return the ways to the neighbours `[3, k, n]` and their lengths `[k, n]`, metres."""
    way = jnp.take(x, jnp.asarray(tables.index), axis=1, mode="clip") - x[:, None]
    return way, jnp.sqrt((way * way).sum(axis=0) + NO_LENGTH**2)
