"""Alternate collision solve and strain limit until few edges are too long.

The solve stretches cloth that it pushes out of a limb: its smooth term is linear and has no edge lengths.
Where a frame ends with more over-long edges than it began with, the strain limit of `pipeline.shape_step`
runs again, with every vertex projected onto its side of its contact's plane, and the result is solved again,
up to `ROUNDS` times. Not in the paper.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from garment_jax.geometry.strain_limit import MOMENTUM, StrainTables, limit_rate, strain_limited
from garment_jax.geometry.triangle import dot
from garment_jax.postprocess.collision.options import CollisionOptions
from garment_jax.postprocess.collision.result import (
    CollisionResult,
    CollisionState,
    Outcome,
    Planes,
    joined,
)
from garment_jax.postprocess.collision.solver import free_vertices, resolve_collisions
from garment_jax.postprocess.collision.tables import CollisionTables

ROUNDS = 8  # of shortening and pushing out at most
DONE = 0.1  # `limit_rate` that calls for no round: the last tenth took as many as all the rest
ENOUGH = 1.0  # `limit_rate` that a round may leave. Caught cloth would try another way in every frame
ITERATIONS = 20  # of shortening a round: after more, the planes of the contacts are no longer the body


class _Last(NamedTuple):
    """Where the next round begins, better or not: cloth around a limb may first get longer."""

    state: CollisionState
    planes: Planes
    excess: jax.Array  # [] as `limit_rate`


class _Best(NamedTuple):
    """What is returned if no later round is better."""

    result: CollisionResult
    state: CollisionState
    excess: jax.Array  # []


def resolve_unstretched(
    V_f: Float[Array, "n 3"],
    collider: Float[Array, "c 3"],
    state: CollisionState,
    *,
    tables: CollisionTables,
    strain: StrainTables,
    as_in: Float[Array, "n 3"],
    pins: Int[Array | np.ndarray, " p"] | None = None,
    pin_positions: Float[Array, "p 3"] | None = None,
    options: CollisionOptions = CollisionOptions(),
) -> tuple[CollisionResult, CollisionState]:
    """Return what `resolve_collisions` does, with no more edges too long than in the frame `as_in` (metres).

    Most frames need no round, and are that function's bitwise. Of all rounds the one with fewest edges too
    long is returned, if they are few enough and no more vertices inside than without; else it is that
    function's as well. What the result says of before is before the first round, `objective` is its own
    round's, `steps` are all that led to it.
    """
    positions = None if pins is None else pin_positions
    free = jnp.asarray(free_vertices(len(V_f), pins))

    resolve = partial(resolve_collisions, tables=tables, pins=pins, pin_positions=positions, options=options)

    def one(carry: tuple[Array, _Last, _Best]):  # the first one too: what compiles once costs half
        rounds, last, best = carry
        first = rounds == 0
        V = jax.lax.cond(first, lambda: V_f, lambda: _shortened(last, strain, as_in))
        result, following = resolve(V, collider, last.state)
        excess = jax.lax.cond(
            first & ((result.outcome == Outcome.NOTHING_TO_DO) | (result.outcome == Outcome.NOT_FINITE)),
            lambda: jnp.zeros((), V.dtype),
            lambda: limit_rate(result.V, strain, as_in=as_in),
        )
        worst = jnp.maximum(best.result.outcome, Outcome.STEPS_SPENT)  # of what may come in its place
        sound = (result.outcome <= worst) & (result.penetrating_after <= best.result.penetrating_after)
        better = first | ((excess <= ENOUGH) & (excess < best.excess) & sound)
        both = joined(best.result, result, first=first)
        kept = jax.lax.cond(better, lambda: _Best(both, following, excess), lambda: best)
        return rounds + 1, _Last(following, result.planes, excess), kept

    shapes = jax.eval_shape(resolve, V_f, collider, state)[0]
    nothing = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
    none = jnp.zeros((), V_f.dtype)
    start = jnp.int32(0), _Last(state, nothing.planes, none), _Best(nothing, state, none)
    rounds, _, (result, state, _) = jax.lax.while_loop(
        lambda carry: (carry[0] == 0) | ((carry[1].excess > DONE) & (carry[0] <= ROUNDS)), one, start
    )
    # the next frame begins where this one ended, whatever the rounds have made of it
    correction = jnp.where(free[:, None], result.V - V_f, 0.0).T
    return result, state._replace(correction=jnp.where(rounds > 1, correction, state.correction))


def _shortened(last: _Last, strain: StrainTables, as_in: Array) -> Array:
    direction = last.planes.direction

    def project(x: Array) -> Array:
        short = jnp.where(direction.any(axis=0), last.planes.height - dot(direction, x), 0.0)
        return x + jnp.maximum(short, 0.0)[None] * direction

    return strain_limited(
        last.state.V.T, strain, as_in=as_in, project=project, iterations=ITERATIONS, momentum=MOMENTUM
    )[0]
