"""Accelerated projected gradient for section 3.5: out of the body, with the folds kept.

Minimises 1/2 ||Lap(V) - Lap(V_f)||^2 subject to ds >= eps. Two departures from the paper: the norm
is squared (same minimiser, and a gradient at zero, where the iteration starts), and the penalty
sum max(eps - ds, 0) is a constraint, met by projection, so that nothing trades depth for shape.
Only the neighbourhood of a contact moves; the rest of the garment comes back bitwise unchanged.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from garment_jax.collision.projection import lift
from garment_jax.collision.region import Region, dilate, make_region, smoothness
from garment_jax.collision.result import CollisionResult, CollisionState, Outcome
from garment_jax.collision.tables import CollisionTables
from garment_jax.geometry.closest_point import ClosestPoint, closest_point_groups, closest_point_posed
from garment_jax.geometry.surface_search import PosedSurface, pose_surface


class CollisionOptions(NamedTuple):
    """Settings of the solver. Lengths in metres; all may be traced but `small`, a size."""

    eps: float = 1e-3  # margin outside the body
    slack: float = 2e-5  # how much of the margin may be missing: float32 and the surface's curvature
    iterations: int = 100  # gradient steps at most
    refresh_every: int = 20  # gradient steps between two searches for correspondences
    tolerance: float = 5e-4  # largest movement between two searches that counts as standing still
    projections: int = 8  # projections at the end at most, each with new correspondences
    rings: int = 4  # edges from a contact to the last vertex that may move
    reach: float = 0.02  # vertices farther out than this need no exact correspondence
    small: int = 128  # groups of 8 vertices in the small solve; a larger region takes the whole garment


class _Progress(NamedTuple):
    """The carry of the outer loop: descend first, then push out what is left inside."""

    x: jax.Array  # [m, 3] displacement from V_f
    y: jax.Array  # [m, 3] the same, extrapolated
    theta: jax.Array  # [] Nesterov's sequence
    at: ClosestPoint  # correspondences of x
    steps: jax.Array  # [] int32 gradient steps taken
    moved: jax.Array  # [] metres, between the last two searches of the descent
    pushes: jax.Array  # [] int32 projections since the descent ended


def resolve_collisions(
    V_f: Float[Array, "n 3"],
    collider_vertices: Float[Array, "c 3"],
    state: CollisionState,
    *,
    tables: CollisionTables,
    pins: Int[Array | np.ndarray, " p"] | None = None,
    pin_positions: Float[Array, "p 3"] | None = None,
    options: CollisionOptions = CollisionOptions(),
) -> tuple[CollisionResult, CollisionState]:
    """Return the garment outside the collider, and the state for the next frame (section 3.5).

    `V_f` and `collider_vertices` in metres, in any frame that both share. `pins` are overwritten
    with `pin_positions` and stay, inside the body or not. Pure and jittable;
    failures are reported in the result (`outcome`, `MESSAGES`), never raised.
    """
    V = V_f if pins is None else V_f.at[pins].set(pin_positions)
    free = jnp.ones(len(V), bool) if pins is None else jnp.ones(len(V), bool).at[pins].set(False)
    finite = jnp.isfinite(V).all() & jnp.isfinite(collider_vertices).all()
    surface = pose_surface(collider_vertices, tables.surface)
    at = closest_point_posed(state.triangle, V, surface, tables.surface, tables.groups, reach=options.reach)
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
    whole, arguments = len(tables.groups), (V, at, moving, free, touched, surface, tables, options)
    if options.small >= whole:
        return _solve_region(whole, *arguments)
    return jax.lax.cond(
        touched.sum() <= options.small,
        lambda: _solve_region(options.small, *arguments),
        lambda: _solve_region(whole, *arguments),
    )


def _solve_region(size, V, at, moving, free, touched, surface, tables, options):
    """Return `(V, triangle, depth, steps, objective, outcome)` with at most `size` groups moving."""
    region = make_region(touched, moving, tables, size)
    base = V[region.vertex]
    here = jax.tree.map(lambda x: x[region.vertex], at)
    end = _iterate(base, here, region, surface, tables, options)
    x, here, moved = end.x, end.at, base + end.x
    V = V.at[jnp.where(region.moving, region.vertex, len(V))].set(moved, mode="drop")
    target = jnp.where(region.own, region.vertex, len(V))
    triangle = at.triangle.at[target].set(here.triangle, mode="drop")
    ds = at.ds.at[target].set(here.ds, mode="drop")
    objective = jnp.sqrt(2 * smoothness(x, region))
    standing = end.moved <= options.tolerance
    return V, triangle, _depth(ds, free), end.steps, objective, _outcome(ds, free, standing, options)


def _outcome(ds, free, standing, options):
    lowest = jnp.where(free, ds, jnp.inf).min()
    outside = jnp.where(standing, Outcome.CONVERGED, Outcome.STEPS_SPENT)
    missed = jnp.where(lowest >= 0, Outcome.MARGIN_MISSED, Outcome.STILL_INSIDE)
    return jnp.where(lowest >= options.eps - options.slack, outside, missed).astype(jnp.int32)


def _locate(positions, here, surface, tables, options):
    """Return the correspondences of a region's vertices, starting from its last ones."""
    shape = (-1, tables.groups.shape[1])
    limit = jnp.where(here.ds < options.reach, jnp.inf, options.reach).reshape(shape)
    points, previous = positions.reshape(*shape, 3), here.triangle.reshape(shape)
    return closest_point_groups(previous, points, limit, surface, tables.surface)


def _iterate(base, here, region: Region, surface: PosedSurface, tables, options) -> _Progress:
    """Return the end of the accelerated projected gradient and of the projections that follow it.

    The descent and the projections share one loop, and so one search: what compiles once costs half.
    """

    def descending(s: _Progress):
        return (s.steps < options.iterations) & (s.moved > options.tolerance)

    def violated(s: _Progress):
        inside = region.moving & (s.at.ds < options.eps - options.slack)
        return inside.any() & (s.pushes < options.projections)

    def outer(s: _Progress) -> _Progress:
        on = descending(s)
        count = jnp.where(on, options.refresh_every, 0)
        inner = partial(_gradient_step, base, s.at, region, tables, options)
        x, y, theta = jax.lax.fori_loop(0, count, inner, (s.x, s.y, s.theta))
        moved = jnp.where(on, jnp.sqrt(((x - s.x) ** 2).sum(axis=-1).max()), s.moved)
        x = jnp.where(on, x, _pushed(base, x, s.at, region, options))
        at = _locate(base + x, s.at, surface, tables, options)
        return _Progress(x, y, theta, at, s.steps + count, moved, s.pushes + jnp.where(on, 0, 1))

    zero = jnp.zeros_like(base)
    moved = jnp.full((), jnp.inf, base.dtype)
    start = _Progress(zero, zero, jnp.ones((), base.dtype), here, jnp.int32(0), moved, jnp.int32(0))
    return jax.lax.while_loop(lambda s: descending(s) | violated(s), outer, start)


def _gradient_step(base, at, region: Region, tables, options, _, carry):
    """Take one step of Nesterov's method along `jax.grad` of the smooth part, then project.

    Restart (O'Donoghue and Candes 2015): momentum that points uphill is thrown away.
    """
    x, y, theta = carry
    ahead = y - jax.grad(smoothness)(y, region) / jnp.asarray(tables.lipschitz, y.dtype)
    new = _pushed(base, jnp.where(region.moving[:, None], ahead, 0.0), at, region, options)
    uphill = ((y - new) * (new - x)).sum() > 0
    theta = jnp.where(uphill, 1.0, theta)
    following = (1 + jnp.sqrt(1 + 4 * theta**2)) / 2
    beta = jnp.where(uphill, 0.0, (theta - 1) / following)
    return new, new + beta * (new - x), following


def _pushed(base, x, at: ClosestPoint, region: Region, options):
    """Return the displacement after projection; where there is no exact correspondence, as it was."""
    height = lift(base + x, at, options.eps)
    return x + jnp.where(region.moving & at.exact, height, 0.0)[:, None] * at.direction
