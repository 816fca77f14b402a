"""Edges brought back to their lengths: what a blurred fold has lost is a fold again.

Not in the paper. Cloth hardly stretches and hardly shrinks, while a network that cannot know where a fold
lies predicts the mean of all places: a smooth surface whose edges are too short, by 3 % in the mean and 30 %
across a deep fold. The displacement that gives them their lengths back, small and of short waves, is a fold
where the prediction has room for one (wrinkle meshes: Mueller and Chentanez 2010). A few accelerated gradient
steps a frame on the elastic energy; each frame goes on from the last one's displacement, so that folds stay
where they are. Edges that are too long, beside the pins most of all, are drawn together by the same steps.
As attachment it comes after the networks and is not fed back; collision handling comes after it.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

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
from garment_jax.programs import ProgramStore

SPREAD = 0.04  # metres: longer waves stay where the networks have them
THICKNESS = 0.018  # metres: the smaller, the nearer edges come to their lengths, and the finer are folds
# How many times its length an edge pushes for: where a crushed one points is chance, and its whole force
# magnified a rounding of the garment a thousand times.
CRUSHED = 1.15
FADE = 0.95  # of the last frame's displacement, where this one begins: too few steps undo what is broad
STEPS = 6  # gradient steps a frame at most; the next frame goes on from there
STILL = 1e-5  # metres: a step that moves no vertex by more is the last
FARTHEST = 0.1  # metres: what a frame that makes no sense may leave behind


class LengthState(NamedTuple):
    """What one frame hands to the next."""

    x: Any  # [3, n] metres, root frame, in the tables' order: the displacement from the prediction


Restorer = Callable[[jax.Array], jax.Array]


def make_length_restorer(
    template: Float[np.ndarray, "n 3"],
    table: LaplacianTable,
    pins: np.ndarray,
    *,
    chunk: int,
    programs: ProgramStore | None = None,
    facts: Mapping[str, Any] = MappingProxyType({}),
) -> Callable[[], Restorer]:
    """Return a function that begins a motion: it returns a function of chunk after chunk, V -> V.

    Chunks are `[chunk, n, 3]` metres in root frames, with `pins` `[p]` where they belong; these stay. The
    function remembers the last frame's displacement; all motions share one compiled program, which `programs`
    builds meanwhile (`facts` name the scene and the configuration). A mesh without edges comes back as it is.
    """
    index = np.asarray(table.index)
    if (index == np.arange(len(index))[:, None]).all():
        return lambda: lambda V: V
    tables = make_elastic_tables(template, table, spread=SPREAD, thickness=THICKNESS, crushed=CRUSHED)
    free = np.ones(len(index), bool)
    free[pins] = False

    @jax.jit
    def restored(state: LengthState, V: jax.Array) -> tuple[LengthState, jax.Array]:
        def frame(state: LengthState, v: jax.Array):
            V, state, _ = restore_lengths(v, state, jnp.asarray(free), tables)
            return state, V

        return jax.lax.scan(frame, state, V)

    n, dtype = len(index), np.float32
    shapes = LengthState(jax.ShapeDtypeStruct((3, n), dtype)), jax.ShapeDtypeStruct((chunk, n, 3), dtype)
    facts = {**facts, "pins": np.asarray(pins).tobytes()}
    program = (programs or ProgramStore(None)).program("edge_lengths", restored, shapes, facts)

    def begin() -> Restorer:
        state = LengthState(jnp.zeros((3, n)))

        def run(V: jax.Array) -> jax.Array:
            nonlocal state
            state, V = program(state, V)
            return V

        return run

    return begin


def restore_lengths(
    V: Float[Array, "n 3"], state: LengthState, free: Bool[Array, " n"], tables: ElasticTables
) -> tuple[Float[Array, "n 3"], LengthState, jax.Array]:
    """Return `V` (metres, root frame) with its edges nearer to their lengths, the state, and the steps taken.

    Only `free` vertices move. A frame with a NaN comes back as it is and is forgotten.
    """
    P, finite = ordered(V.T, tables), jnp.isfinite(V).all()
    edges, movable = edges_of(P, tables), ordered(free, tables)

    def moving(carry):
        _, _, _, moved, steps = carry
        return finite & (moved > STILL**2) & (steps < STEPS)

    def step(carry):
        x, y, theta, _, steps = carry
        downhill = elastic_gradient(y, edges, tables) / tables.lipschitz
        new, y, theta = accelerated(jnp.where(movable[None], y - downhill, 0.0), x, y, theta)
        return new, y, theta, jnp.square(new - x).sum(axis=0).max(), steps + 1

    one = jnp.ones((), P.dtype)
    x = FADE * state.x
    x, _, _, _, steps = jax.lax.while_loop(moving, step, (x, x, one, one, jnp.int32(0)))
    kept = jnp.clip(jnp.where(finite, x, state.x), -FARTHEST, FARTHEST)
    return jnp.where(finite, disordered(P + x, tables).T, V), LengthState(kept), steps
