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

from garment_jax.collision.contacts import Contacts, crossing_limit, find_contacts, probed
from garment_jax.collision.projection import lift
from garment_jax.collision.region import Region, dilate, make_region, smoothness
from garment_jax.collision.result import CollisionResult, CollisionState, Outcome
from garment_jax.collision.tables import CollisionTables
from garment_jax.geometry.marked import WORD
from garment_jax.geometry.surface_search import PosedSurface, pose_surface

FAR = 5e-3  # metres after which a bound from before is not trusted
PROBE = 0.05  # metres: how deep a vertex may be that is inside unnoticed and found in its turn


class CollisionOptions(NamedTuple):
    """Settings of the solver. Lengths in metres; all may be traced but `small`, a size."""

    eps: float = 1e-3  # margin outside the body
    slack: float = 0.05  # part of the margin that may be missing: the surface's curvature, and float32
    reach: float = 2e-3  # vertices so much beyond the margin are kept from the body from the first step
    iterations: int = 20  # gradient steps at most
    refresh_every: int = 10  # gradient steps between two searches for correspondences
    tolerance: float = 5e-4  # largest movement between two searches that counts as standing still
    projections: int = 8  # projections at the end at most, each with new correspondences
    rings: int = 4  # edges from a contact to the last vertex that may move
    small: int = 768  # vertices in the small solve, in 32s; a larger region takes the whole garment


class _Progress(NamedTuple):
    """The carry of the outer loop: descend first, then push out what is left inside."""

    x: jax.Array  # [m, 3] displacement from V_f
    y: jax.Array  # [m, 3] the same, extrapolated
    theta: jax.Array  # [] Nesterov's sequence
    at: Contacts  # correspondences of x
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

    `V_f` and `collider_vertices` in metres, in any frame that both share; the state's last frame in the
    same, or one that has moved a little. `pins` are overwritten with `pin_positions` and stay, inside
    the body or not. The descent begins from the last frame's correction. Pure and jittable; failures
    are reported in the result (`outcome`, `MESSAGES`), never raised.
    """
    V = V_f if pins is None else V_f.at[pins].set(pin_positions)
    free = jnp.ones(len(V), bool) if pins is None else jnp.ones(len(V), bool).at[pins].set(False)
    finite = jnp.isfinite(V).all() & jnp.isfinite(collider_vertices).all()
    surface = pose_surface(collider_vertices, tables.surface)
    probe = probed(state.frame, jnp.asarray(tables.groups), len(V))
    at = _detect(V, free & finite, probe, state, surface, tables, options)
    contact = free & at.known & (at.ds < options.eps * (1 - options.slack))
    before = _depth(at, free)

    def solve():
        return _solve(V, at, contact, free, state.correction, surface, tables, options)

    def leave():
        outcome = jnp.where(finite, Outcome.NOTHING_TO_DO, Outcome.NOT_FINITE).astype(jnp.int32)
        return V, at, jnp.int32(0), jnp.zeros((), V.dtype), outcome

    before_ds = at.ds
    V_out, at, steps, objective, outcome = jax.lax.cond(contact.any(), solve, leave)
    after = _depth(at, free)
    converged = (outcome == Outcome.NOTHING_TO_DO) | (outcome == Outcome.CONVERGED)
    result = CollisionResult(
        V_out, before[0], after[0], before[1], after[1], steps, objective, converged, outcome
    )
    outside = ~at.known | (at.ds >= 0)
    outside = outside & ~_betrayed(probe & state.outside & (before_ds < 0), tables)
    following = CollisionState(at.triangle, V_out, collider_vertices, outside, V_out - V, state.frame + 1)
    return result, jax.tree.map(lambda new, old: jnp.where(finite, new, old), following, state)


def _detect(V, asked, probe, state, surface, tables, options) -> Contacts:
    """Return what is within the margin, or may have crossed the surface since the last frame."""
    groups = jnp.asarray(tables.groups)
    limit = crossing_limit(V, state, surface, tables.surface, groups)
    limit = jnp.maximum(limit, jnp.where(probe, PROBE, options.eps + options.reach))
    limit = jnp.where(asked, jnp.where(state.outside, limit, jnp.inf), -1.0)
    zero = jnp.zeros_like(V)
    unknown = Contacts(state.triangle, zero[:, 0], jnp.zeros(len(V), bool), zero, zero)
    return find_contacts(V - surface.origin[None], unknown, limit, groups, surface, tables.surface)


def _betrayed(wrong: Array, tables) -> Array:
    """Return the vertices of every group with a probe inside that was thought outside."""
    groups = jnp.asarray(tables.groups)
    group = jnp.broadcast_to(wrong[groups].any(axis=1)[:, None], groups.shape)
    return jnp.zeros(len(wrong), bool).at[groups].max(group)


def _depth(at: Contacts, counted: Array) -> tuple[Array, Array]:
    """Return the deepest penetration (metres) and the number of vertices inside."""
    inside = counted & at.known & (at.ds < 0)
    return jnp.where(inside, -at.ds, 0.0).max(), inside.sum().astype(jnp.int32)


def _solve(V, at, contact, free, correction, surface, tables, options):
    """Solve on the vertices around the contacts, or on the whole garment when they are too many."""
    moving = dilate(contact, tables, options.rings) & free
    touched = dilate(moving, tables, 1)
    whole = -(-len(V) // WORD) * WORD
    arguments = (V, at, moving, touched, correction, free, surface, tables, options)
    if options.small >= whole:
        return _solve_region(whole, *arguments)
    return jax.lax.cond(
        touched.sum() <= options.small,
        lambda: _solve_region(options.small, *arguments),
        lambda: _solve_region(whole, *arguments),
    )


def _solve_region(size, V, at, moving, touched, correction, free, surface, tables, options):
    """Return `(V, contacts, steps, objective, outcome)` of at most `size` vertices."""
    region = make_region(touched, moving, tables, size)
    base = V[region.vertex] - surface.origin[None]
    start = jnp.where(region.moving[:, None], correction[region.vertex], 0.0)
    here = jax.tree.map(lambda x: x[region.vertex], at)
    end = _iterate(base, start, here, region, surface, tables, options)
    target = jnp.where(region.moving, region.vertex, len(V))
    at = jax.tree.map(lambda x, y: x.at[target].set(y, mode="drop"), at, end.at)
    V = V.at[target].add(end.x, mode="drop")
    objective = jnp.sqrt(2 * smoothness(end.x, region))
    return V, at, end.steps, objective, _outcome(at, free, end.moved <= options.tolerance, options)


def _outcome(at: Contacts, free, standing, options):
    lowest = jnp.where(free & at.known, at.ds, jnp.inf).min()
    outside = jnp.where(standing, Outcome.CONVERGED, Outcome.STEPS_SPENT)
    missed = jnp.where(lowest >= 0, Outcome.MARGIN_MISSED, Outcome.STILL_INSIDE)
    return jnp.where(lowest >= options.eps * (1 - options.slack), outside, missed).astype(jnp.int32)


def _locate(base, x, since, at: Contacts, region: Region, surface, tables, options) -> Contacts:
    """Return the contacts of a region's vertices after they moved from `since` to `x`.

    Only those are searched that may have come within the margin; the others' distance shrinks by what
    they have moved, which keeps it a lower bound. Where parts of the body cross each other, that bound
    may rest on the wrong sign: after a long way it is not trusted.
    """
    shift = jnp.sqrt(((x - since) ** 2).sum(axis=-1))
    far = shift > FAR
    asked = region.moving & (far | (at.ds - shift < options.eps))
    limit = jnp.where(at.known | far, jnp.inf, jnp.maximum(shift, options.eps))
    groups = jnp.arange(len(x), dtype=jnp.int32).reshape(-1, tables.groups.shape[1])
    moved = at._replace(ds=at.ds - shift)
    return find_contacts(base + x, moved, jnp.where(asked, limit, -1.0), groups, surface, tables.surface)


def _iterate(base, start, here, region: Region, surface: PosedSurface, tables, options) -> _Progress:
    """Return the end of the accelerated projected gradient and of the projections that follow it.

    The descent and the projections share one loop, and so one search: what compiles once costs half.
    """

    def descending(s: _Progress):
        return (s.steps < options.iterations) & (s.moved > options.tolerance)

    def violated(s: _Progress):
        inside = region.moving & s.at.known & (s.at.ds < options.eps * (1 - options.slack))
        return inside.any() & (s.pushes < options.projections)

    def outer(s: _Progress) -> _Progress:
        on = descending(s)
        count = jnp.where(on, options.refresh_every, 0)
        inner = partial(_gradient_step, base, s.at, region, tables, options)
        x, y, theta = jax.lax.fori_loop(0, count, inner, (s.x, s.y, s.theta))
        moved = jnp.where(on, jnp.sqrt(((x - s.x) ** 2).sum(axis=-1).max()), s.moved)
        x = jnp.where(on, x, _pushed(base, x, s.at, region, options))
        at = _locate(base, x, jnp.where(s.steps == 0, 0.0, s.x), s.at, region, surface, tables, options)
        return _Progress(x, y, theta, at, s.steps + count, moved, s.pushes + jnp.where(on, 0, 1))

    moved = jnp.full((), jnp.inf, base.dtype)
    progress = _Progress(start, start, jnp.ones((), base.dtype), here, jnp.int32(0), moved, jnp.int32(0))
    return jax.lax.while_loop(lambda s: descending(s) | violated(s), outer, progress)


def _gradient_step(base, at: Contacts, region: Region, tables, options, _, carry):
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


def _pushed(base, x, at: Contacts, region: Region, options):
    """Return the displacement after projection; where there is no correspondence, as it was."""
    height = lift(base + x, at, options.eps)
    return x + jnp.where(region.moving & at.known, height, 0.0)[:, None] * at.direction
