"""Undo self-crossings: what lies in itself is pushed apart, and flattened where that is not enough.

A network that predicts the mean of folds it cannot know has them pass through each other. A push moves
places on the cloth, some 10 cm apart, so that the lines of crossing grow shorter, and keeps the waves of the
cloth. It cannot undo every crossing, and deep ones not at once. So every vertex has a weight as well: up to 1
it goes to the garment without waves of some 30 cm and shorter, up to 2 to one without twice that. Both grow
pass by pass while something crosses, stay for some frames and then fade, so that a fold neither opens nor
closes at once. A frame without crossings, after others without, comes back as it is. Not in the paper, whose
stated limit it is.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from garment_jax.geometry.crossing_contours import ContourTables, make_contour_tables, shorter_contours
from garment_jax.geometry.low_pass import LowPassTables, low_pass, make_low_pass
from garment_jax.geometry.self_crossings import (
    CrossingTables,
    Found,
    find_self_crossings,
    make_crossing_tables,
)
from garment_jax.geometry.topology import neighbour_table, unique_edges
from garment_jax.postprocess.collision.result import chosen

REACHES = (0.07, 0.14)  # metres, of weights 1 and 2
PASSES = 16  # of moving and looking in a frame
PUSHES = 2  # of them at most without flattening
STEP = 0.015  # metres by which a push moves what crosses, at most
PUSH = 0.06  # metres of all of them at most
STAYS = 0.96  # of the last frame's pushes
SPACING = 0.1  # metres of cloth between places that are pushed
MOST_PLACES = 256
FEW = 0.1  # crossings around a place at which a push is halved
GROWTH = 0.15  # added to a weight where a pass still finds a crossing
FADE = 0.9  # of the last frame's weights
GONE = 1e-3  # weight that counts as none
STILL = 1e-5  # metres of a push that count as none
HOLD = 10.0  # frames before either fades where it grew
HELD_BACK = 0.1  # growth from which on it does not fade
SPREAD = 0.145  # metres of cloth over which the growth around a crossing falls to 1 / e of it
REACH = 0.19  # metres of cloth from a crossing, about, from which on nothing grows
MOST_RINGS = 32  # of neighbours that this may take
HELD = 0.05  # metres from a pin within which cloth goes with it


class UntangleTables(NamedTuple):
    """What does not change from frame to frame (static)."""

    crossings: CrossingTables
    ring: np.ndarray  # [k, n] int32 neighbours, padded with the vertex itself
    near: np.ndarray  # [k, n] float32, part of a neighbour's growth that comes over
    rings: int  # how often it does
    low_pass: LowPassTables
    pin: np.ndarray  # [n] int32, the nearest one
    held: np.ndarray  # [n] float32, 1 at a pin, 0 far from any
    contours: ContourTables
    places: np.ndarray  # [n, c] float32, how far a vertex goes with each place that is pushed


class UntangleState(NamedTuple):
    """What one frame hands to the next."""

    weight: jax.Array  # [n] 0 to 2, of flattening
    push: jax.Array  # [c, 3] metres, of the places
    calm: tuple[jax.Array, jax.Array]  # [n] and [c], frames since either grew there


def make_untangle_tables(
    template: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], pins: Int[np.ndarray, " p"]
) -> UntangleTables:
    """Return the tables of a garment with at least one face (`template` in metres)."""
    n = len(template)
    pin, held = np.zeros(n, np.int32), np.zeros(n, np.float32)
    if len(pins):
        far, nearest = KDTree(template[pins]).query(template)
        pin, held = np.asarray(pins, np.int32)[nearest], np.exp(-((far / HELD) ** 2)).astype(np.float32)
        held[held < 1e-6] = 0  # no denormals, which are slow
    ring = np.ascontiguousarray(neighbour_table(faces, n).index.T, np.int32)
    length = np.linalg.norm(template[ring] - template, axis=-1)
    edge = float(length[length > 0].mean()) if length.any() else REACH
    crossings = make_crossing_tables(template, faces)
    return UntangleTables(
        crossings,
        ring,
        np.exp(-length / SPREAD).astype(np.float32),
        int(np.clip(round(REACH / edge), 1, MOST_RINGS)),
        make_low_pass(template, faces, REACHES),
        pin,
        held,
        make_contour_tables(faces, crossings),
        (1 - held)[:, None] * _places(template, faces),
    )


def _places(template: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return how far each vertex goes with each of some places `SPACING` apart on the cloth, `[n, c]`."""
    ends, n = unique_edges(faces), len(template)
    length = np.linalg.norm(template[ends[:, 0]] - template[ends[:, 1]], axis=1).astype(np.float64) + 1e-12
    ways = csr_matrix((length, ends.T), (n, n))
    away, place = [], int(faces[0, 0])
    nearest = np.where(np.isin(np.arange(n), faces), np.inf, 0.0)  # what no face has is never moved
    while len(away) < MOST_PLACES and nearest.max() > SPACING:
        away.append(dijkstra(ways, directed=False, indices=place))
        nearest = np.minimum(nearest, away[-1])
        place = int(nearest.argmax())
    reach = 1.8 * max(float(nearest[np.isfinite(nearest)].max()), 1e-9)
    part = np.square(np.maximum(1 - np.square(np.stack(away, axis=1) / reach), 0.0))
    return (part / np.maximum(part.sum(axis=1, keepdims=True), 1e-9)).astype(np.float32)


def init_untangle(tables: UntangleTables) -> UntangleState:
    """Return the state before a garment's first frame."""
    n, places = tables.places.shape
    return UntangleState(jnp.zeros(n), jnp.zeros((places, 3)), (jnp.zeros(n), jnp.zeros(places)))


def faded(state: UntangleState) -> UntangleState:
    """Return the state that a frame begins with."""
    calm = jax.tree.map(lambda frames: jnp.minimum(frames + 1, HOLD + 1), state.calm)
    weight = jnp.where(calm[0] > HOLD, FADE, 1.0) * state.weight
    push = jnp.where(calm[1] > HOLD, STAYS, 1.0)[:, None] * state.push
    weight, push = jnp.where(weight < GONE, 0.0, weight), jnp.where(jnp.abs(push) < STILL, 0.0, push)
    return UntangleState(weight, push, calm)


def untangle(
    state: UntangleState,
    V: Float[Array, "n 3"],
    tables: UntangleTables,
    *,
    look: bool | Bool[Array, ""] = True,
) -> tuple[UntangleState, Float[Array, "n 3"], Int[Array, ""]]:
    """Return the state, `V` (metres) pushed and flattened by it, and how many edges still go through a face.

    Where nothing crosses and the state is all zero, `V` comes back bitwise. Pins stay. A frame with a NaN
    comes back as it is. Where more crosses in the end than by the state that was given, this is kept. Without
    `look` it is taken as it is, and no edge counts.
    """

    def attempt(carry: tuple[Any, ...]) -> tuple[Any, ...]:
        own, _, _, passes, given, by_given = carry
        x = _moved(V, own, tables)
        own, left = jax.lax.cond(
            look, lambda: grown(own, x, tables, flatten=passes >= PUSHES), lambda: (own, jnp.int32(0))
        )
        begins = passes == 0
        return own, x, left, passes + 1, jnp.where(begins, x, given), jnp.where(begins, left, by_given)

    start = (state, V, jnp.int32(1), jnp.int32(0), V, jnp.int32(0))
    own, x, left, _, given, by_given = jax.lax.while_loop(
        lambda c: (c[2] > 0) & (c[3] < PASSES), attempt, start
    )
    own, x, left = chosen(left > by_given, (state, given, by_given), (own, x, left))
    finite = jnp.isfinite(V).all()
    return chosen(finite, own, init_untangle(tables)), jnp.where(finite, x, V), left


def grown(
    state: UntangleState,
    V: Float[Array, "n 3"],
    tables: UntangleTables,
    *,
    flatten: bool | Bool[Array, ""],
) -> tuple[UntangleState, Int[Array, ""]]:
    """Return the state with more of what undoes the crossings in `V`, and how many edges go through a face.

    `flatten`: more weight where something crosses, beside the push.
    """
    found = find_self_crossings(V, tables.crossings)

    def more() -> UntangleState:
        weight, calm = jax.lax.cond(
            flatten, lambda: _grown(state, found, tables), lambda: (state.weight, state.calm[0])
        )
        sums, many = shorter_contours(V, found, tables.contours)
        places = jnp.asarray(tables.places)
        around = places.T @ many
        step = STEP * (places.T @ sums) / (around[:, None] + FEW)
        quiet = jnp.where(around > FEW, 0.0, state.calm[1])
        return UntangleState(weight, jnp.clip(state.push + step, -PUSH, PUSH), (calm, quiet))

    return jax.lax.cond(found.edges > 0, more, lambda: state), found.edges


def _moved(V: Array, state: UntangleState, tables: UntangleTables) -> Array:
    """Return `V` pushed, then flattened."""
    V = jax.lax.cond(state.push.any(), lambda: V + jnp.asarray(tables.places) @ state.push, lambda: V)
    return jax.lax.cond(state.weight.any(), lambda: _flattened(V, state.weight, tables), lambda: V)


def _flattened(V: Array, weight: Array, tables: UntangleTables) -> Array:
    pin, held = jnp.asarray(tables.pin), jnp.asarray(tables.held)
    x, before = V, V
    for level, flat in enumerate(low_pass(V, tables.low_pass)):
        flat = flat - held[:, None] * (flat - V)[pin]
        x = x + jnp.clip(weight - level, 0.0, 1.0)[:, None] * (flat - before)
        before = flat
    return jnp.where((held == 1.0)[:, None], V, x)


def _grown(state: UntangleState, found: Found, tables: UntangleTables) -> tuple[Array, Array]:
    """Return the weights, grown around what crosses, and for how many frames they have not."""

    def spread(_: Array, b: Array) -> Array:
        return jnp.maximum(b, (jnp.asarray(tables.near) * b[jnp.asarray(tables.ring)]).max(axis=0))

    grown = jax.lax.fori_loop(0, tables.rings, spread, found.vertices.astype(state.weight.dtype))
    weight = jnp.minimum(state.weight + GROWTH * grown, float(len(REACHES)))
    return weight, jnp.where(grown > HELD_BACK, 0.0, state.calm[0])
