"""Restore edge lengths: folds that the networks have averaged away come back.

Not in the paper. A network that cannot know where a fold lies predicts the mean over its possible places: a
smooth surface whose edges are too short, by 3 % in the mean and by 30 % across a deep fold. A small,
short-wave displacement that restores the lengths makes a fold where the prediction has room for one (wrinkle
meshes: Mueller and Chentanez 2010). Each frame takes a few accelerated gradient steps on the elastic energy,
starting from the last frame's displacement, so that folds stay in place, and with its momentum, without which
fine ripples grow long before broad folds do. The same steps shorten edges that are too long, most of them
beside the pins. Not fed back into the networks.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from garment_jax.geometry.elastic import (
    ElasticTables,
    accelerated,
    disordered,
    edges_of,
    elastic_gradient,
    make_elastic_tables,
    ordered,
)
from garment_jax.geometry.laplacian import LaplacianTable

SPREAD = 0.025  # metres: longer waves stay where the networks have them
THICKNESS = 0.022  # metres: the smaller, the nearer edges come to their lengths, and the finer are folds
# How many times its length an edge pushes for: where a crushed one points is chance, and its whole force
# magnified a rounding of the garment a thousand times.
CRUSHED = 1.1
FADE = 0.9  # of the last frame's displacement, where this one begins: too few steps undo what is broad
STEPS = 4  # gradient steps a frame at most; the next frame goes on from there
STILL = 1e-5  # metres: a step that moves no vertex by more is the last
FARTHEST = 0.1  # metres: what a frame that makes no sense may leave behind


class LengthState(NamedTuple):
    """What one frame hands to the next."""

    x: jax.Array  # [3, n] metres, root frame, in the tables' order: the displacement from the prediction
    ahead: jax.Array  # [3, n] where momentum carries it
    theta: jax.Array  # [] of Nesterov's sequence


def init_lengths(n: int) -> LengthState:
    """Return the state before the first frame of a garment of `n` vertices: nothing displaced."""
    return LengthState(jnp.zeros((3, n)), jnp.zeros((3, n)), jnp.ones(()))


def make_length_tables(template: Float[np.ndarray, "n 3"], table: LaplacianTable) -> ElasticTables | None:
    """Return the tables of a garment (`template` in metres); None for a mesh without edges."""
    index = np.asarray(table.index)
    if (index == np.arange(len(index))[:, None]).all():
        return None
    return make_elastic_tables(template, table, spread=SPREAD, thickness=THICKNESS, crushed=CRUSHED)


def restore_lengths(
    state: LengthState, V: Float[Array, "n 3"], *, free: Bool[Array, " n"], tables: ElasticTables
) -> tuple[LengthState, Float[Array, "n 3"], Int[Array, ""]]:
    """Return the state, `V` (metres, root frame) with its edges nearer to their lengths, and the steps taken.

    Only `free` vertices move. A frame with a NaN comes back as it is and is forgotten.
    """
    P, finite = ordered(V.T, tables), jnp.isfinite(V).all()
    edges, movable = edges_of(P, tables), ordered(free, tables)

    def step(carry: tuple[Array, ...]) -> tuple[Array, ...]:
        x, y, theta, _, steps = carry
        downhill = elastic_gradient(y, edges, tables) / tables.lipschitz
        new = jnp.where(movable[None], y - downhill, 0.0)
        y, theta = accelerated(new, x, y, theta)
        return new, y, theta, jnp.square(new - x).sum(axis=0).max(), steps + 1

    first = (FADE * state.x, FADE * state.ahead, state.theta, jnp.ones((), P.dtype), jnp.int32(0))
    x, ahead, theta, _, steps = jax.lax.while_loop(
        lambda carry: finite & (carry[3] > STILL**2) & (carry[4] < STEPS), step, first
    )
    following = LengthState(jnp.clip(x, -FARTHEST, FARTHEST), jnp.clip(ahead, -FARTHEST, FARTHEST), theta)
    kept = jax.tree.map(partial(jnp.where, finite), following, state)
    return kept, jnp.where(finite, disordered(P + x, tables).T, V), steps
