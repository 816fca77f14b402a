"""Undo self-crossings: a fold that lies in itself is flattened until it does not.

A network that predicts the mean of folds it cannot know has them pass through each other. Without its short
waves around a crossing, cloth has none left, and is no farther from the truth. So every vertex has a weight:
up to 1 it goes to the garment without waves of some 30 cm and shorter, up to 2 to one without twice that.
Weights grow around what still crosses, pass by pass, and fade from frame to frame, so that a fold neither
opens nor closes at once. A frame without crossings, after others without, comes back as it is. Not in the
paper, whose stated limit it is.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.spatial import KDTree

from garment_jax.geometry.low_pass import LowPassTables, low_pass, make_low_pass
from garment_jax.geometry.self_crossings import (
    CrossingTables,
    Found,
    find_self_crossings,
    make_crossing_tables,
)
from garment_jax.geometry.topology import neighbour_table

REACHES = (0.07, 0.14)  # metres, of weights 1 and 2
PASSES = 16  # of flattening and looking in a frame
GROWTH = 0.15  # added to a weight where a pass still finds a crossing
FADE = 0.95  # of the last frame's weights
GONE = 1e-3  # weight that counts as none
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


class UntangleState(NamedTuple):
    """What one frame hands to the next."""

    weight: jax.Array  # [n] 0 to 2, of flattening


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
    return UntangleTables(
        make_crossing_tables(template, faces),
        ring,
        np.exp(-length / SPREAD).astype(np.float32),
        int(np.clip(round(REACH / edge), 1, MOST_RINGS)),
        make_low_pass(template, faces, REACHES),
        pin,
        held,
    )


def init_untangle(n: int) -> UntangleState:
    """Return the state before the first frame of a garment of `n` vertices."""
    return UntangleState(jnp.zeros(n))


def faded(state: UntangleState) -> UntangleState:
    """Return the weights that a frame begins with."""
    weight = FADE * state.weight
    return UntangleState(jnp.where(weight < GONE, 0.0, weight))


def untangle(
    state: UntangleState,
    V: Float[Array, "n 3"],
    tables: UntangleTables,
    *,
    look: bool | Bool[Array, ""] = True,
) -> tuple[UntangleState, Float[Array, "n 3"], Int[Array, ""]]:
    """Return the weights, `V` (metres) flattened by them, and how many edges still go through a face.

    Where nothing crosses and all weights are 0, `V` comes back bitwise. Pins stay. A frame with a NaN comes
    back as it is. Where more crosses in the end than by the weights that were given, these are kept. Without
    `look` they are taken as they are, and no edge counts.
    """

    def attempt(carry: tuple[Array, ...]) -> tuple[Array, ...]:
        weight, _, _, passes, given, by_given = carry
        x = jax.lax.cond(weight.any(), lambda: _flattened(V, weight, tables), lambda: V)
        weight, left = jax.lax.cond(look, lambda: _looked(weight, x, tables), lambda: (weight, jnp.int32(0)))
        begins = passes == 0
        return weight, x, left, passes + 1, jnp.where(begins, x, given), jnp.where(begins, left, by_given)

    start = (state.weight, V, jnp.int32(1), jnp.int32(0), V, jnp.int32(0))
    weight, x, left, _, given, by_given = jax.lax.while_loop(
        lambda c: (c[2] > 0) & (c[3] < PASSES), attempt, start
    )
    worse = left > by_given
    weight, x, left = (
        jnp.where(worse, a, b) for a, b in ((state.weight, weight), (given, x), (by_given, left))
    )
    finite = jnp.isfinite(V).all()
    return UntangleState(jnp.where(finite, weight, 0.0)), jnp.where(finite, x, V), left


def grown(
    state: UntangleState, V: Float[Array, "n 3"], tables: UntangleTables
) -> tuple[UntangleState, Array]:
    """Return the weights, grown around what crosses in `V`, and how many edges do."""
    weight, left = _looked(state.weight, V, tables)
    return UntangleState(weight), left


def _looked(weight: Array, V: Array, tables: UntangleTables) -> tuple[Array, Array]:
    found = find_self_crossings(V, tables.crossings)
    return jax.lax.cond(found.edges > 0, lambda: _grown(weight, found, tables), lambda: weight), found.edges


def _flattened(V: Array, weight: Array, tables: UntangleTables) -> Array:
    pin, held = jnp.asarray(tables.pin), jnp.asarray(tables.held)
    x, before = V, V
    for level, flat in enumerate(low_pass(V, tables.low_pass)):
        flat = flat - held[:, None] * (flat - V)[pin]
        x = x + jnp.clip(weight - level, 0.0, 1.0)[:, None] * (flat - before)
        before = flat
    return jnp.where((held == 1.0)[:, None], V, x)


def _grown(weight: Array, found: Found, tables: UntangleTables) -> Array:
    def spread(_: Array, b: Array) -> Array:
        return jnp.maximum(b, (jnp.asarray(tables.near) * b[jnp.asarray(tables.ring)]).max(axis=0))

    grown = jax.lax.fori_loop(0, tables.rings, spread, found.vertices.astype(weight.dtype))
    return jnp.minimum(weight + GROWTH * grown, float(len(REACHES)))
