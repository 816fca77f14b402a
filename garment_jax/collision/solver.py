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
from jaxtyping import Array, Bool, Float, Int

from garment_jax.collision.contacts import (
    Contacts,
    boxes_of,
    collider_of,
    crossing_limit,
    find_again,
    find_contacts,
    in_groups,
    of_group,
    probed,
)
from garment_jax.collision.descent import Iterate, advance
from garment_jax.collision.region import Members, dilate, displacement_norm, find_members, nobody
from garment_jax.collision.result import CollisionResult, CollisionState, Outcome, Planes
from garment_jax.collision.tables import CollisionTables
from garment_jax.geometry.apart import apart, materialised
from garment_jax.geometry.surface_search import PosedSurface, pose_surface
from garment_jax.geometry.triangle import dot, squared_length

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
    """The carry of a frame's loop: descend, search, descend, ..., push out what is left inside, search."""

    now: Iterate
    at: Contacts  # correspondences of the displacement `searched`
    searched: jax.Array  # [3, n]
    steps: jax.Array  # [] int32 gradient steps taken
    moved: jax.Array  # [] metres, between the last two searches of the descent
    pushes: jax.Array  # [] int32 projections since the descent ended


class _Frame(NamedTuple):
    """What does not change during a frame's loop."""

    local: jax.Array  # [3, n] V_f with its pins, relative to the surface's origin
    members: Members
    surface: PosedSurface


@apart
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
    free = free_vertices(len(V_f), pins)
    surface = pose_surface(collider_vertices, tables.surface)
    planes, local, finite = _placed(V_f, pins, pin_positions, surface)
    grouped = in_groups(local, tables)
    boxes = boxes_of(grouped)
    limit = _first_limit(planes, boxes, free, finite, state, surface, tables, options)
    first = find_contacts(local, grouped, state.triangle, limit, boxes, surface, tables)
    members, x = _begun(first, free, state.correction, tables, options)
    end = _iterate(_Frame(local, members, surface), first, x, tables, options)
    planes, V = _answer(planes, members.moving, end.now.x)
    deepest_before, before = _depth(first, free)
    deepest, after = _depth(end.at, free)
    outcome = _outcome(end, members.count > 0, free, finite, options)
    result = CollisionResult(
        V=V,
        deepest_before=deepest_before,
        deepest_after=deepest,
        penetrating_before=before,
        penetrating_after=after,
        steps=end.steps,
        objective=displacement_norm(end.now.x, members, tables),
        converged=(outcome == Outcome.NOTHING_TO_DO) | (outcome == Outcome.CONVERGED),
        outcome=outcome,
        planes=_walls(end.at, free, surface.origin, options),
    )
    following = CollisionState(
        triangle=end.at.triangle,
        V=planes,
        collider=collider_of(surface),
        outside=_outside(state, first, end.at, free, tables),
        correction=_moved_by(members.moving, end.now.x),
        frame=state.frame + 1,
    )
    return result, _if_finite(finite, following, state)


def free_vertices(n: int, pins: Int[Array | np.ndarray, " p"] | None) -> Bool[Array | np.ndarray, " n"]:
    """Return which of `n` vertices are not pinned; on the host where the pins are."""
    if pins is None or isinstance(pins, np.ndarray):
        return ~np.isin(np.arange(n), [] if pins is None else pins)
    return jnp.ones(n, bool).at[pins].set(False)


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


@apart
def _placed(V_f, pins, pin_positions, surface: PosedSurface) -> tuple[Array, Array, Array]:
    """Return the garment with its pins `[3, n]`, the same from the surface's origin, and if all is finite."""
    planes = _planes_of(V_f if pins is None else V_f.at[pins].set(pin_positions))
    finite = jnp.isfinite(planes).all() & jnp.isfinite(surface.origin).all()  # the origin: a mean of the body
    return planes, planes - surface.origin[:, None], finite


@apart
def _planes_of(V: Float[Array, "n 3"]) -> Float[Array, "3 n"]:
    return V.T


@apart
def _first_limit(planes, boxes, free, finite, state, surface, tables, options) -> Array:
    """Return how far to search: the margin, or what may have crossed the surface since the last frame."""
    limit = crossing_limit(boxes, planes - state.V, state, surface, tables)
    limit = jnp.maximum(limit, jnp.where(probed(state.frame, tables), PROBE, options.eps + options.reach))
    return jnp.where(free & finite, jnp.where(state.outside, limit, jnp.inf), -1.0)


@apart
def _depth(at: Contacts, counted) -> tuple[Array, Array]:
    """Return the deepest penetration (metres) and how many vertices are inside."""
    inside = _inside(at, counted)
    return jnp.where(inside, -at.ds, 0.0).max(), inside.sum().astype(jnp.int32)


def _inside(at: Contacts, counted) -> Array:
    return counted & at.known & (at.ds < 0)


@apart
def _outcome(end: _Progress, solved, free, finite, options) -> Array:
    lowest = jnp.where(free & end.at.known, end.at.ds, jnp.inf).min()
    outside = jnp.where(end.moved <= options.tolerance, Outcome.CONVERGED, Outcome.STEPS_SPENT)
    missed = jnp.where(lowest >= 0, Outcome.MARGIN_MISSED, Outcome.STILL_INSIDE)
    found = jnp.where(lowest >= options.eps * (1 - options.slack), outside, missed)
    untouched = jnp.where(finite, Outcome.NOTHING_TO_DO, Outcome.NOT_FINITE)
    return jnp.where(solved, found, untouched).astype(jnp.int32)


@apart
def _answer(planes: Float[Array, "3 n"], moving, x) -> tuple[Array, Array]:
    """Return the garment moved by `x`, `[3, n]` and `[n, 3]`; bitwise as it was where nothing moves."""
    planes = jnp.where(moving[None], planes + x, planes)
    return planes, planes.T


@apart
def _moved_by(moving, x: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
    return jnp.where(moving[None], x, 0.0)


@apart
def _walls(at: Contacts, free, origin: Float[Array, "3"], options) -> Planes:
    direction = jnp.where((free & at.known)[None], at.direction, 0.0)
    return Planes(direction, dot(at.point + origin[:, None], direction) + options.eps)


@apart
def _outside(state: CollisionState, first: Contacts, at: Contacts, free, tables) -> Bool[Array, " n"]:
    """Return which vertices are outside: but for the groups with a probe inside that was thought outside."""
    betrayed = _groups_with(probed(state.frame, tables) & state.outside & _inside(first, free), tables)
    return (~at.known | (at.ds >= 0)) & ~of_group(betrayed, tables)


@apart
def _groups_with(marks: Bool[Array, " n"], tables) -> Bool[Array, " g"]:
    return materialised(marks)[jnp.asarray(tables.groups.T)].any(axis=0)


@apart
def _if_finite(finite, following: CollisionState, state: CollisionState) -> CollisionState:
    return jax.tree.map(lambda new, old: jnp.where(finite, new, old), following, state)


@apart
def _begun(first: Contacts, free, correction, tables, options) -> tuple[Members, Array]:
    """Return what moves, if anything, and from where."""
    contact = free & first.known & (first.ds < options.eps * (1 - options.slack))

    def solve():
        moving = dilate(contact, tables, options.rings) & free
        return find_members(moving, tables), jnp.where(moving[None], correction, 0.0)

    return jax.lax.cond(contact.any(), solve, lambda: (nobody(tables), jnp.zeros_like(correction)))


def _iterate(frame: _Frame, first: Contacts, x: Array, tables: CollisionTables, options) -> _Progress:
    """Return the end of a frame's loop; without a contact it is not entered."""
    margin = options.eps * (1 - options.slack)

    def descending(s: _Progress):
        return (s.steps < options.iterations) & (s.moved > options.tolerance)

    def violated(s: _Progress):
        lowest = jnp.where(frame.members.moving & s.at.known, s.at.ds, jnp.inf).min()
        # what half of the projections left nearer than the margin, but outside, has no room for it
        wanted = jnp.where(s.pushes < (options.projections + 1) // 2, margin, 0.0)
        return (lowest < wanted) & (s.pushes < options.projections)

    def more(s: _Progress):
        return (frame.members.count > 0) & (descending(s) | violated(s))

    def body(s: _Progress) -> _Progress:
        on, margin = descending(s), _push_margin(s.pushes, options)
        now = advance(on, s.now, frame.local, s.at, frame.members, tables, options, margin=margin)
        local, ds, limit = _next_limit(now.x, s.searched, frame.local, s.at, frame.members.moving, options)
        at = find_again(local, s.at._replace(ds=ds), limit, frame.surface, tables)
        return _Progress(now, at, now.x, *_counted(on, s.steps, s.moved, s.pushes, now.x, s.now.x, options))

    none, one = jnp.int32(0), jnp.ones((), x.dtype)
    start = _Progress(Iterate(x, x, one), first, jnp.zeros_like(x), none, jnp.inf * one, none)
    return jax.lax.while_loop(more, body, start)


def _push_margin(pushes: Array, options) -> Array:
    """Return the margin of a projection: in the second half of them, half of the last one's each time.

    That half is for what is inside. Pushed out of one wall by the whole margin, a vertex in a narrower gap
    is inside the other, and so on; nearer to the wall there is room for it.
    """
    return options.eps * 0.5 ** jnp.maximum(pushes - options.projections // 2 + 1, 0)


@apart
def _counted(on, steps, moved, pushes, x: Float[Array, "3 n"], last: Float[Array, "3 n"], options):
    """Return the steps taken, how far the last ones moved, and the projections."""
    moved = jnp.where(on, jnp.sqrt(squared_length(x - last).max()), moved)
    return steps + jnp.where(on, options.refresh_every, 0), moved, pushes + jnp.where(on, 0, 1)


@apart
def _next_limit(x, searched, base: Float[Array, "3 n"], at: Contacts, moving, options) -> tuple[Array, ...]:
    """Return the vertices moved by `x`, their distances or bounds, and how far to search around them.

    Only those are asked that may have come within the margin; the others' distance shrinks by what
    they have moved, which keeps it a lower bound. Where parts of the body cross each other, that bound
    may rest on the wrong sign: after a long way it is not trusted.
    """
    shift = jnp.sqrt(squared_length(x - searched))
    local, ds, far = base + x, at.ds - shift, shift > FAR
    asked = moving & (far | (ds < options.eps))
    away = local - at.point  # the point is still on the surface: none is farther
    bound = jnp.sqrt(squared_length(away)) * (1 + 1e-4) + 1e-6
    limit = jnp.where(far, jnp.inf, jnp.maximum(shift, options.eps))
    return local, ds, jnp.where(asked, jnp.where(at.known, bound, limit), -1.0)
