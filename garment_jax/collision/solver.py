"""Accelerated projected gradient for section 3.5: out of the body, with the folds kept.

Minimises 1/2 ||Lap(V) - Lap(V_f)||^2 subject to ds >= eps. Two departures from the paper: the norm
is squared (same minimiser, and a gradient at zero, where the iteration starts), and the penalty
sum max(eps - ds, 0) is a constraint, met by projection, so that nothing trades depth for shape.
Only the neighbourhood of a contact moves; the rest of the garment comes back bitwise unchanged.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from garment_jax.collision.projection import lift, project
from garment_jax.collision.region import Region, dilate, make_region, smoothness
from garment_jax.collision.result import CollisionResult, CollisionState, Outcome
from garment_jax.collision.tables import CollisionTables
from garment_jax.geometry.closest_point import ClosestPoint, closest_point_groups, closest_point_posed
from garment_jax.geometry.surface_search import PosedSurface, pose_surface


class CollisionOptions(NamedTuple):
    """Settings of the solver (static). Lengths in metres."""

    eps: float = 1e-3  # margin outside the body
    slack: float = 2e-5  # how much of the margin may be missing: float32 and the surface's curvature
    iterations: int = 60  # gradient steps at most
    refresh_every: int = 10  # gradient steps between two searches for correspondences
    tolerance: float = 1e-4  # largest movement between two searches that counts as standing still
    projections: int = 8  # projections at the end at most, each with new correspondences
    rings: int = 6  # edges from a contact to the last vertex that may move
    reach: float = 0.02  # vertices farther out than this need no exact correspondence
    small: int = 64  # groups of 8 vertices in the small solve; a larger region takes the whole garment


class _Descent(NamedTuple):
    """The carry of the outer loop."""

    x: jax.Array  # [m, 3] displacement from V_f
    y: jax.Array  # [m, 3] the same, extrapolated
    theta: jax.Array  # [] Nesterov's sequence
    at: ClosestPoint  # correspondences of x
    steps: jax.Array  # [] int32
    moved: jax.Array  # [] metres, since the previous search


def resolve_collisions(
    V_f: Float[Array, "n 3"],
    collider_vertices: Float[Array, "c 3"],
    state: CollisionState,
    *,
    tables: CollisionTables,
    pins: Int[Array, " p"] | None = None,
    pin_positions: Float[Array, "p 3"] | None = None,
    options: CollisionOptions = CollisionOptions(),
) -> tuple[CollisionResult, CollisionState]:
    """Return the garment outside the collider, and the state for the next frame (section 3.5).

    `V_f` and `collider_vertices` in metres, in any frame that both share. `pins` are overwritten
    with `pin_positions` and stay, inside the body or not. Pure and jittable, `options` static;
    failures are reported in the result (`outcome`, `MESSAGES`), never raised.
    """
    V = V_f if pins is None else V_f.at[pins].set(pin_positions)
    free = jnp.ones(len(V), bool) if pins is None else jnp.ones(len(V), bool).at[pins].set(False)
    finite = jnp.isfinite(V).all() & jnp.isfinite(collider_vertices).all()
    surface = pose_surface(collider_vertices, tables.surface)
    at = closest_point_posed(
        state.triangle, V, surface, tables.surface, tables.groups, reach=options.reach
    )
    contact = free & (at.ds < options.eps - options.slack) & finite
    before = _depth(at.ds, free)

    def solve():
        return _solve(V, at, contact, free, surface, tables, options)

    def leave():
        outcome = jnp.where(finite, Outcome.NOTHING_TO_DO, Outcome.NOT_FINITE).astype(jnp.int32)
        return V, at.triangle, before, jnp.int32(0), jnp.float32(0.0), outcome

    V, triangle, after, steps, objective, outcome = jax.lax.cond(contact.any(), solve, leave)
    converged = (outcome == Outcome.NOTHING_TO_DO) | (outcome == Outcome.CONVERGED)
    result = CollisionResult(
        V, before[0], after[0], before[1], after[1], steps, objective, converged, outcome
    )
    triangle = jnp.where(finite, triangle, state.triangle)
    return result, CollisionState(triangle)


def _depth(ds: Array, counted: Array) -> tuple[Array, Array]:
    """Return the deepest penetration (metres) and the number of vertices inside."""
    inside = counted & (ds < 0)
    return jnp.where(inside, -ds, 0.0).max(), inside.sum().astype(jnp.int32)


def _solve(V, at, contact, free, surface, tables, options):
    """Solve on the groups around the contacts, or on the whole garment when they are too many."""
    moving = dilate(contact, tables, options.rings) & free
    touched = (dilate(moving, tables, 1)[tables.groups]).any(axis=1)
    small = min(options.small, len(tables.groups))
    arguments = (V, at, moving, free, touched, surface, tables, options)
    return jax.lax.cond(
        touched.sum() <= small,
        lambda: _solve_region(small, *arguments),
        lambda: _solve_region(len(tables.groups), *arguments),
    )


def _solve_region(size, V, at, moving, free, touched, surface, tables, options):
    """Return `(V, triangle, depth, steps, objective, outcome)` with at most `size` groups moving."""
    region = make_region(touched, moving, tables, size)
    base = V[region.vertex]
    here = jax.tree.map(lambda x: x[region.vertex], at)
    x, here, steps, standing = _descend(base, here, region, surface, tables, options)
    moved, here = _push_out(base + x, here, region, surface, tables, options)
    x = moved - base
    V = V.at[jnp.where(region.moving, region.vertex, len(V))].set(moved, mode="drop")
    target = jnp.where(region.own, region.vertex, len(V))
    triangle = at.triangle.at[target].set(here.triangle, mode="drop")
    ds = at.ds.at[target].set(here.ds, mode="drop")
    objective = jnp.sqrt(2 * smoothness(x, region))
    return V, triangle, _depth(ds, free), steps, objective, _outcome(ds, free, standing, options)


def _outcome(ds, free, standing, options):
    lowest = jnp.where(free, ds, jnp.inf).min()
    outside = jnp.where(standing, Outcome.CONVERGED, Outcome.STEPS_SPENT)
    missed = jnp.where(lowest >= 0, Outcome.MARGIN_MISSED, Outcome.STILL_INSIDE)
    return jnp.where(lowest >= options.eps - options.slack, outside, missed).astype(jnp.int32)


def _locate(positions, here, surface, tables):
    """Return the exact correspondences of a region's vertices, starting from its last ones."""
    shape = (-1, tables.groups.shape[1])
    return closest_point_groups(
        here.triangle.reshape(shape), positions.reshape(*shape, 3), surface, tables.surface
    )


def _descend(base, here, region: Region, surface: PosedSurface, tables, options):
    """Return `(x, correspondences, steps, standing still)` of the accelerated projected gradient."""
    step = 1.0 / jnp.asarray(tables.lipschitz)

    def inner(_, carry):
        x, y, theta, at = carry
        ahead = jnp.where(region.moving[:, None], y - step * jax.grad(smoothness)(y, region), 0.0)
        height = jnp.where(region.moving & at.exact, lift(base + ahead, at, options.eps), 0.0)
        new = ahead + height[:, None] * at.direction
        # Restart (O'Donoghue and Candes 2015): momentum that points uphill is thrown away.
        uphill = ((y - new) * (new - x)).sum() > 0
        theta = jnp.where(uphill, 1.0, theta)
        following = (1 + jnp.sqrt(1 + 4 * theta**2)) / 2
        beta = jnp.where(uphill, 0.0, (theta - 1) / following)
        return new, new + beta * (new - x), following, at

    def outer(s: _Descent) -> _Descent:
        start = (s.x, s.y, s.theta, s.at)
        x, y, theta, _ = jax.lax.fori_loop(0, options.refresh_every, inner, start)
        at = _locate(base + x, s.at, surface, tables)
        moved = jnp.sqrt(((x - s.x) ** 2).sum(axis=-1).max())
        return _Descent(x, y, theta, at, s.steps + options.refresh_every, moved)

    def unfinished(s: _Descent):
        return (s.steps < options.iterations) & (s.moved > options.tolerance)

    zero = jnp.zeros_like(base)
    start = _Descent(zero, zero, jnp.float32(1.0), here, jnp.int32(0), jnp.float32(jnp.inf))
    end = jax.lax.while_loop(unfinished, outer, start)
    return end.x, end.at, end.steps, end.moved <= options.tolerance


def _push_out(positions, here, region: Region, surface: PosedSurface, tables, options):
    """Project until the exact signed distances hold; return `(positions, their correspondences)`.

    The last thing done to the positions is a projection, what follows it only looks.
    """

    def violated(at):
        return (region.moving & (at.ds < options.eps - options.slack)).any()

    def again(carry):
        count, positions, at = carry
        pushed = jnp.where(region.moving[:, None], project(positions, at, options.eps), positions)
        return count + 1, pushed, _locate(pushed, at, surface, tables)

    start = (jnp.int32(0), positions, here)
    _, positions, here = jax.lax.while_loop(
        lambda carry: (carry[0] < options.projections) & violated(carry[2]), again, start
    )
    return positions, here
