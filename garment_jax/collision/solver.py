"""Accelerated projected gradient for section 3.5: out of the body, with the folds kept.

Minimises 1/2 ||Lap(V) - Lap(V_f)||^2 subject to ds >= eps. Two departures from the paper: the norm
is squared (same minimiser, and a gradient at zero, where the iteration starts), and the penalty
sum max(eps - ds, 0) is a constraint, met by projection, so that nothing trades depth for shape.
Only the neighbourhood of a contact moves; the rest of the garment comes back bitwise unchanged.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from garment_jax.collision.contacts import (
    Contacts,
    branch_gaps,
    crossing_limit,
    find_contacts,
    of_group,
    probed,
)
from garment_jax.collision.descent import Iterate, advance
from garment_jax.collision.region import Members, dilate, displacement_norm, find_members, nobody
from garment_jax.collision.result import CollisionResult, CollisionState, Outcome, Planes
from garment_jax.collision.tables import CollisionTables
from garment_jax.geometry.surface_search import PosedSurface, pose_surface

FAR = 5e-3  # metres after which a bound from before is not trusted
PROBE = 0.05  # metres: how deep a vertex may be that is inside unnoticed and found in its turn


class CollisionOptions(NamedTuple):
    """Settings of the solver. Lengths in metres; all may be traced but `sizes`."""

    eps: float = 1e-3  # margin outside the body
    slack: float = 0.05  # part of the margin that may be missing: the surface's curvature, and float32
    reach: float = 2e-3  # vertices so much beyond the margin are kept from the body from the first step
    iterations: int = 20  # gradient steps at most
    refresh_every: int = 10  # gradient steps between two searches for correspondences
    tolerance: float = 5e-4  # largest movement between two searches that counts as standing still
    projections: int = 8  # projections at the end at most, each with new correspondences
    rings: int = 4  # edges from a contact to the last vertex that may move
    sizes: tuple[float, ...] = (
        0.09,
        0.18,
        0.27,
        0.36,
    )  # of regions, in parts of the garment; beyond: all of it


class _Progress(NamedTuple):
    """The carry of a frame's loop: search, descend, search, ..., push out what is left inside, search.

    All of it shares one search: what compiles once costs a third, and a frame without contact leaves
    after the first.
    """

    now: Iterate
    at: Contacts  # correspondences of the displacement `searched`
    searched: jax.Array  # [n, 3]
    members: Members
    searches: jax.Array  # [] int32
    steps: jax.Array  # [] int32 gradient steps taken
    moved: jax.Array  # [] metres, between the last two searches of the descent
    pushes: jax.Array  # [] int32 projections since the descent ended
    deepest: jax.Array  # [] metres, at the first search
    inside: jax.Array  # [n] bool, at the first search


class _Frame(NamedTuple):
    """What does not change during a frame."""

    local: jax.Array  # [n, 3] V_f with its pins, relative to the surface's origin
    free: jax.Array  # [n] bool, not pinned
    limit: jax.Array  # [n] metres, of the first search
    correction: jax.Array  # [n, 3] the last frame's
    gap_squared: jax.Array  # [g, w] of the groups and the surface's branches
    surface: PosedSurface


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
    the body or not. The descent begins from the last frame's correction. Failures are reported in the
    result (`outcome`, `MESSAGES`), never raised.

    Pure; works under `jit`, `vmap` and `jvp`. There is no reverse-mode gradient, for the iteration is a
    `while_loop`: `penetration` is the form to differentiate, in a training loss for example.
    Raises `ValueError` unless `pins` and `pin_positions` come together and are as many.
    """
    check_pins(pins, pin_positions)
    V = V_f if pins is None else V_f.at[pins].set(pin_positions)
    free = jnp.ones(len(V), bool) if pins is None else jnp.ones(len(V), bool).at[pins].set(False)
    finite = jnp.isfinite(V).all() & jnp.isfinite(collider_vertices).all()
    surface = pose_surface(collider_vertices, tables.surface)
    probe, local = probed(state.frame, tables), V - surface.origin[None]
    gaps = branch_gaps(local, surface, tables)
    limit = _first_limit(V, gaps, probe, state, surface, tables, options)
    limit = jnp.where(free & finite, limit, -1.0)
    end = _iterate(_Frame(local, free, limit, state.correction, gaps, surface), state, tables, options)

    solved = end.members.count > 0
    V_out = jnp.where(end.members.moving[:, None], V + end.now.x, V)
    objective = displacement_norm(end.now.x, end.members, tables)
    untouched = jnp.where(finite, Outcome.NOTHING_TO_DO, Outcome.NOT_FINITE).astype(jnp.int32)
    outcome = jnp.where(solved, _outcome(end.at, free, end.moved <= options.tolerance, options), untouched)
    converged = (outcome == Outcome.NOTHING_TO_DO) | (outcome == Outcome.CONVERGED)
    deepest, inside = _depth(end.at, free)
    before, after = end.inside.sum().astype(jnp.int32), inside.sum().astype(jnp.int32)
    direction = jnp.where((free & end.at.known)[:, None], end.at.direction, 0.0)
    height = ((end.at.point + surface.origin[None]) * direction).sum(axis=-1) + options.eps
    planes = Planes(direction, height)
    result = CollisionResult(
        V_out, end.deepest, deepest, before, after, end.steps, objective, converged, outcome, planes
    )
    outside = ~end.at.known | (end.at.ds >= 0)
    outside = outside & ~_betrayed(probe & state.outside & end.inside, tables)
    following = CollisionState(end.at.triangle, V_out, collider_vertices, outside, V_out - V, state.frame + 1)
    return result, jax.tree.map(lambda new, old: jnp.where(finite, new, old), following, state)


def check_pins(pins, pin_positions) -> None:
    """Raise `ValueError` unless both are None or there are as many positions `[p, 3]` as pins."""
    if (pins is None) != (pin_positions is None):
        given, missing = ("pins", "pin_positions") if pin_positions is None else ("pin_positions", "pins")
        raise ValueError(f"{given} came without {missing}; give both, or neither where nothing is pinned.")
    if pins is not None and jnp.shape(pin_positions) != (len(pins), 3):
        raise ValueError(
            f"pin_positions is {list(jnp.shape(pin_positions))} for {len(pins)} pins; "
            f"give [{len(pins)}, 3], a position for each."
        )


def _first_limit(V, gaps, probe, state, surface, tables, options) -> Array:
    """Return how far to search: the margin, or what may have crossed the surface since the last frame."""
    limit = crossing_limit(gaps, V, state, surface, tables)
    limit = jnp.maximum(limit, jnp.where(probe, PROBE, options.eps + options.reach))
    return jnp.where(state.outside, limit, jnp.inf)


def _betrayed(wrong: Array, tables) -> Array:
    """Return the vertices of every group with a probe inside that was thought outside."""
    return of_group(wrong[jnp.asarray(tables.groups)].any(axis=1), tables)


def _depth(at: Contacts, counted: Array) -> tuple[Array, Array]:
    """Return the deepest penetration (metres) and which vertices are inside `[n]`."""
    inside = counted & at.known & (at.ds < 0)
    return jnp.where(inside, -at.ds, 0.0).max(), inside


def _outcome(at: Contacts, free, standing, options):
    lowest = jnp.where(free & at.known, at.ds, jnp.inf).min()
    outside = jnp.where(standing, Outcome.CONVERGED, Outcome.STEPS_SPENT)
    missed = jnp.where(lowest >= 0, Outcome.MARGIN_MISSED, Outcome.STILL_INSIDE)
    return jnp.where(lowest >= options.eps * (1 - options.slack), outside, missed).astype(jnp.int32)


def _iterate(frame: _Frame, state: CollisionState, tables: CollisionTables, options) -> _Progress:
    """Return the end of a frame's loop; without a contact it ends after the first search."""
    n, dtype = len(frame.local), frame.local.dtype
    margin = options.eps * (1 - options.slack)

    def descending(s: _Progress):
        return (s.steps < options.iterations) & (s.moved > options.tolerance)

    def violated(s: _Progress):
        inside = s.members.moving & s.at.known & (s.at.ds < margin)
        return inside.any() & (s.pushes < options.projections)

    def more(s: _Progress):
        return (s.searches == 0) | ((s.members.count > 0) & (descending(s) | violated(s)))

    def body(s: _Progress) -> _Progress:
        first, on = s.searches == 0, descending(s)
        kind = jnp.where(first, 0, jnp.where(on, 2, 1))
        margin = _push_margin(s.pushes, options)
        now = advance(kind, s.now, frame.local, s.at, s.members, tables, options, margin=margin)
        apart = jnp.sqrt(((now.x - s.now.x) ** 2).sum(axis=-1).max())
        at, limit = _next_limit(now.x, s, frame, options)
        limit, moved = jnp.where(first, frame.limit, limit), jnp.sqrt((now.x * now.x).sum(axis=-1))
        surroundings = moved, frame.gap_squared, frame.surface, tables
        at = find_contacts(frame.local + now.x, at, limit, *surroundings)
        descended, pushed = (on & ~first).astype(jnp.int32), (~on & ~first).astype(jnp.int32)
        s = s._replace(
            now=now,
            at=at,
            searched=now.x,
            searches=s.searches + 1,
            steps=s.steps + descended * options.refresh_every,
            moved=jnp.where(on & ~first, apart, s.moved),
            pushes=s.pushes + pushed,
        )
        return _begun(s, first, frame, tables, options)

    zero, none = jnp.zeros((n, 3), dtype), jnp.zeros(n, bool)
    count = jnp.int32(0)
    start = _Progress(
        Iterate(zero, zero, jnp.ones((), dtype)),
        Contacts(state.triangle, zero[:, 0], none, zero, zero),
        zero,
        nobody(tables),
        count,
        count,
        jnp.full((), jnp.inf, dtype),
        count,
        jnp.zeros((), dtype),
        none,
    )
    return jax.lax.while_loop(more, body, start)


def _push_margin(pushes: Array, options) -> Array:
    """Return the margin of a projection: in the second half of them, half of the last one's each time.

    Pushed out of one wall by the whole margin, a vertex in a narrower gap is inside the other, and so on;
    nearer to the wall there is room for it.
    """
    return options.eps * 0.5 ** jnp.maximum(pushes - options.projections // 2 + 1, 0)


def _begun(s: _Progress, first: Array, frame: _Frame, tables, options) -> _Progress:
    """Return the progress with what the first search finds: what moves, if anything, and from where."""
    deepest, inside = _depth(s.at, frame.free)
    contact = frame.free & s.at.known & (s.at.ds < options.eps * (1 - options.slack))

    def solve():
        moving = dilate(contact, tables, options.rings) & frame.free
        return find_members(moving, tables), jnp.where(moving[:, None], frame.correction, 0.0)

    members, x = jax.lax.cond(first & contact.any(), solve, lambda: (s.members, s.now.x))
    y = jnp.where(first, x, s.now.y)
    deepest, inside = (jnp.where(first, new, old) for new, old in ((deepest, s.deepest), (inside, s.inside)))
    return s._replace(now=Iterate(x, y, s.now.theta), members=members, deepest=deepest, inside=inside)


def _next_limit(x, s: _Progress, frame: _Frame, options) -> tuple[Contacts, Array]:
    """Return the contacts, and how far to search around vertices that moved from `s.searched` to `x`.

    Only those are asked that may have come within the margin; the others' distance shrinks by what
    they have moved, which keeps it a lower bound. Where parts of the body cross each other, that bound
    may rest on the wrong sign: after a long way it is not trusted.
    """
    shift = jnp.sqrt(((x - s.searched) ** 2).sum(axis=-1))
    far = shift > FAR
    asked = s.members.moving & (far | (s.at.ds - shift < options.eps))
    away = frame.local + x - s.at.point  # the point is still on the surface: none is farther
    bound = jnp.sqrt((away * away).sum(axis=-1)) * (1 + 1e-4) + 1e-6
    limit = jnp.where(far, jnp.inf, jnp.maximum(shift, options.eps))
    limit = jnp.where(asked, jnp.where(s.at.known, bound, limit), -1.0)
    return s.at._replace(ds=s.at.ds - shift), limit
