"""What collision handling returns, and what each outcome means."""

from enum import IntEnum
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from garment_jax.geometry.noinline import noinline

T = TypeVar("T")


class Outcome(IntEnum):
    """How a frame ended (`CollisionResult.outcome`)."""

    NOTHING_TO_DO = 0
    CONVERGED = 1
    STEPS_SPENT = 2
    MARGIN_MISSED = 3
    STILL_INSIDE = 4
    NOT_FINITE = 5


MESSAGES = {
    Outcome.NOTHING_TO_DO: "Every free vertex was outside by the margin; nothing was pushed out.",
    Outcome.CONVERGED: "Every free vertex is outside by the margin and the steps fell below the tolerance.",
    Outcome.STEPS_SPENT: "Every free vertex is outside by the margin, but the step budget ended before the "
    "tolerance was met; more steps (--iterations, collision.iterations in a configuration) make the garment "
    "smoother.",
    Outcome.MARGIN_MISSED: "No free vertex is inside, but some are nearer than the margin, as between two "
    "parts of the body that touch; accept it or choose a smaller one (--eps, collision.eps in a "
    "configuration).",
    Outcome.STILL_INSIDE: "Some free vertices are still inside the body after the last projection; parts of "
    "the body may cross each other there.",
    Outcome.NOT_FINITE: "The garment or the body holds a NaN or an infinite coordinate; the input came back "
    "with its pins in place and nothing else was done.",
}


class CollisionState(NamedTuple):
    """What one frame hands to the next: where everything was, and how it had been corrected.

    Coordinates come first, as everywhere within the solver: so that they vectorise.
    """

    triangle: jax.Array  # [n] int32 row of the surface tables, near the vertex
    V: jax.Array  # [3, n] metres, the last frame's answer
    collider: jax.Array  # [3, c] metres, the last frame's body
    outside: jax.Array  # [n] bool: outside; what is must cross the surface to get in
    correction: jax.Array  # [3, n] metres, answer minus input: the next solve begins from it
    crossing: jax.Array  # [] bool: some vertex was near a sheet within another part, or nothing is known


class Planes(NamedTuple):
    """What keeps each vertex outside: direction . v >= height, in the frame of the input."""

    direction: jax.Array  # [3, n] unit vectors, 0 where no surface is near or the vertex is pinned
    height: jax.Array  # [n] metres


class CollisionResult(NamedTuple):
    """One frame after collision handling. Depths and counts leave out the pinned vertices."""

    V: jax.Array  # [n, 3] metres, in the frame of the input
    deepest_before: jax.Array  # [] metres inside the body, 0 if none
    deepest_after: jax.Array  # [] metres
    penetrating_before: jax.Array  # [] int32 vertices inside; by their nearest sheets alone, as is
    # `deepest_before`, where the solve has moved out what these were wrong about
    penetrating_after: jax.Array  # [] int32
    steps: jax.Array  # [] int32 gradient steps taken
    objective: jax.Array  # [] metres, ||Lap(V_f) - Lap(V)||, the norm over the whole mesh
    converged: jax.Array  # [] bool
    outcome: jax.Array  # [] int32, an `Outcome`; `MESSAGES` has its sentence
    planes: Planes  # of the last search


@noinline
def chosen(condition: Bool[Array, ""], tree: T, other: T) -> T:
    """Return `tree` where the condition holds, else the `other` one."""
    return jax.tree.map(lambda x, y: jnp.where(condition, x, y), tree, other)


def joined(
    before: CollisionResult, result: CollisionResult, *, first: bool | Bool[Array, ""]
) -> CollisionResult:
    """Return a `result` of what `before` had left as one of both: what was before, and the steps of both.

    `first`: there was nothing before.
    """
    moved = jnp.logical_not(first) & (before.outcome != Outcome.NOTHING_TO_DO)
    nothing = moved & (result.outcome == Outcome.NOTHING_TO_DO)
    return result._replace(
        deepest_before=jnp.where(first, result.deepest_before, before.deepest_before),
        penetrating_before=jnp.where(first, result.penetrating_before, before.penetrating_before),
        steps=before.steps + result.steps,
        outcome=jnp.where(nothing, Outcome.CONVERGED, result.outcome).astype(jnp.int32),
    )
