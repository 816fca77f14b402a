"""Edges that are too short brought back to their lengths: what a blurred fold has lost goes into a fold again.

Not in the paper. Cloth hardly stretches and hardly shrinks, while a network that cannot know where a fold
lies predicts the mean of all places: a smooth surface whose edges are too short, by 3 % in the mean and 30 %
across a deep fold. The displacement that gives them their lengths back, small and of short waves, is a fold
where the prediction has room for one (wrinkle meshes: Mueller and Chentanez 2010). A few accelerated gradient
steps a frame on the elastic energy; each frame goes on from the last one's displacement, so that folds stay
where they are. Edges that are too long are left alone: tight cloth is stretched (`strain_limit`). As
attachment it comes after the networks and is not fed back; collision handling comes after it.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from garment_jax.geometry.elastic import (
    ElasticTables,
    accelerated,
    elastic_gradient,
    make_elastic_tables,
    planes_laplacian,
)
from garment_jax.geometry.laplacian import LaplacianTable

SPREAD = 0.04  # metres: longer waves stay where the networks have them
THICKNESS = 0.026  # metres: the smaller, the nearer edges come to their lengths, and the finer are folds
FADE = 0.95  # of the last frame's displacement, where this one begins: too few steps undo what is broad
STEPS = 6  # gradient steps a frame at most; the next frame goes on from there
STILL = 1e-5  # metres: a step that moves no vertex by more is the last


class LengthState(NamedTuple):
    """What one frame hands to the next."""

    x: jax.Array  # [3, n] metres, root frame: the displacement from the prediction


Restorer = Callable[[jax.Array], jax.Array]


def make_length_restorer(
    template: Float[np.ndarray, "n 3"], table: LaplacianTable, pins: np.ndarray
) -> Callable[[], Restorer]:
    """Return a function that begins a motion: it returns a function of chunk after chunk, V -> V.

    Chunks are `[k, n, 3]` metres in root frames, with `pins` `[p]` where they belong; these stay. The
    function remembers the last frame's displacement; all motions share one compiled program. A mesh without
    edges comes back as it is.
    """
    index = np.asarray(table.index)
    if (index == np.arange(len(index))[:, None]).all():
        return lambda: lambda V: V
    tables = make_elastic_tables(template, table, spread=SPREAD, thickness=THICKNESS, stretched=False)
    free = np.ones(len(index), bool)
    free[pins] = False

    @jax.jit
    def restored(state: LengthState, V: jax.Array) -> tuple[LengthState, jax.Array]:
        def frame(state: LengthState, v: jax.Array):
            V, state, _ = restore_lengths(v, state, jnp.asarray(free), tables)
            return state, V

        return jax.lax.scan(frame, state, V)

    def begin() -> Restorer:
        state = LengthState(jnp.zeros((3, len(index))))

        def run(V: jax.Array) -> jax.Array:
            nonlocal state
            state, V = restored(state, V)
            return V

        return run

    return begin


def restore_lengths(
    V: Float[Array, "n 3"], state: LengthState, free: Bool[Array, " n"], tables: ElasticTables
) -> tuple[Float[Array, "n 3"], LengthState, jax.Array]:
    """Return `V` (metres, root frame) with no edge much shorter than it is, the state, and the steps taken.

    Only `free` vertices move. A frame with a NaN comes back as it is and is forgotten.
    """
    P, finite = V.T, jnp.isfinite(V).all()
    L = planes_laplacian(P, tables)

    def moving(carry):
        _, _, _, moved, steps = carry
        return finite & (moved > STILL**2) & (steps < STEPS)

    def step(carry):
        x, y, theta, _, steps = carry
        downhill = elastic_gradient(y, P, L, tables) / tables.lipschitz
        new, y, theta = accelerated(jnp.where(free[None], y - downhill, 0.0), x, y, theta)
        return new, y, theta, jnp.square(new - x).sum(axis=0).max(), steps + 1

    one = jnp.ones((), P.dtype)
    x = FADE * state.x
    x, _, _, _, steps = jax.lax.while_loop(moving, step, (x, x, one, one, jnp.int32(0)))
    return jnp.where(finite, (P + x).T, V), LengthState(jnp.where(finite, x, state.x)), steps
