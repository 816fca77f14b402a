"""Accelerated projected gradient for section 3.5: out of the body, with the folds kept.

Minimises 1/2 ||Lap(V) - Lap(V_f)||^2 subject to ds >= eps. Two departures from the paper: the norm
is squared (same minimiser, and a gradient at zero, where the iteration starts), and the penalty
sum max(eps - ds, 0) is a constraint, met by projection, so that nothing trades depth for shape.
Only the neighbourhood of a contact moves; the rest of the garment comes back bitwise unchanged.
"""

from enum import IntEnum
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from garment_jax.geometry.gather import coordinates_of
from garment_jax.geometry.noinline import fusion_barrier, noinline
from garment_jax.geometry.surface_search import PosedSurface, pose_surface
from garment_jax.geometry.triangle import dot
from garment_jax.postprocess.collision.contacts import (
    Contacts,
    collider_of,
    crossing_limit,
    find_again,
    find_contacts,
)
from garment_jax.postprocess.collision.loop import End, iterate
from garment_jax.postprocess.collision.options import CollisionOptions
from garment_jax.postprocess.collision.region import Members, dilate, find_members
from garment_jax.postprocess.collision.result import CollisionResult, CollisionState, Outcome, Planes, chosen
from garment_jax.postprocess.collision.tables import CollisionTables
from garment_jax.postprocess.collision.union import sided

ROUNDS = 9  # of a frame at most that push out what is inside where parts of the body cross


@noinline
def resolve_collisions(
    V_f: Float[Array, "n 3"],
    collider: Float[Array, "c 3"],
    state: CollisionState,
    *,
    tables: CollisionTables,
    pins: Int[Array | np.ndarray, " p"] | None = None,
    pin_positions: Float[Array, "p 3"] | None = None,
    options: CollisionOptions = CollisionOptions(),
) -> tuple[CollisionResult, CollisionState]:
    """Return the garment outside the collider, and the state for the next frame (section 3.5).

    `V_f` and `collider` in metres, in any frame that both share; the state's last frame in the
    same, or one that has moved a little. `pins` are overwritten with `pin_positions` and stay, inside
    the body or not. The descent begins from the last frame's correction. Failures are reported in the
    result (`outcome`, `MESSAGES`), never raised.

    Pure; works under `jit` and `vmap`, in 32 bits. No gradient, for the iteration is a `while_loop`:
    `penetration` is the form to differentiate, in a training loss.
    Raises `ValueError` unless `pins` and `pin_positions` come together and are as many.
    """
    check_pins(pins, pin_positions)
    # in the widest of their floating-point types: both ends of a frame must agree in it
    kind = jnp.result_type(V_f, collider, state.V, state.collider, state.correction)
    V_f, collider = jnp.asarray(V_f, kind), jnp.asarray(collider, kind)
    wide = {name: jnp.asarray(getattr(state, name), kind) for name in ("V", "collider", "correction")}
    state = state._replace(**wide)
    free = jnp.asarray(free_vertices(len(V_f), pins))
    surface = pose_surface(collider, tables.surface)
    V, P, local, finite = _placed(V_f, pins, pin_positions, surface)
    found = _first_contacts(P, local, free, finite, state, surface, tables, options)

    none, nobody = jnp.zeros((), P.dtype), jnp.zeros(len(V), bool)
    still = End(jnp.zeros_like(P), found, jnp.int32(0), none, none)

    def one(s: _Round) -> _Round:
        def solve() -> _Acted:
            at = s.end.at
            contact = _in_contact(at, free, options)
            members, x = _begun(contact, free, state.correction, tables, options)
            end = iterate(local, x, at, members, surface, tables, options)
            asked = jnp.where(s.checked, members.moving, end.at.known)
            return _Acted(end, members.moving, asked, _depth(at, free))

        def push() -> _Acted:
            margin = options.eps * 0.5 ** jnp.maximum(s.pushes - 2, 0)
            x = s.end.x + jnp.where(s.inside, margin - s.end.at.ds, 0.0)[None] * s.end.at.direction
            limit = jnp.where(s.inside, jnp.inf, -1.0)
            at = find_again(local + x, s.end.at, limit, surface, tables)
            return _Acted(s.end._replace(x=x, at=at), s.moving, s.inside, s.before)

        acted = jax.lax.switch(s.act, [lambda: _Acted(still, nobody, found.known, s.before), solve, push])
        at, crossing = sided(acted.end.at, acted.asked, local + acted.end.x, surface, tables)
        inside = acted.moving & at.known & (at.ds < 0)
        once_more = inside.any() & (s.pushes < ROUNDS)
        then = jnp.stack(
            [
                jnp.where(_in_contact(at, free, options).any(), Act.SOLVE, Act.END),
                jnp.where(crossing & ~s.checked, Act.CHECK, jnp.where(once_more, Act.PUSH, Act.END)),
                jnp.where(once_more, Act.PUSH, Act.END),
            ]
        )
        return _Round(
            act=then[s.act],
            end=acted.end._replace(at=at),
            moving=acted.moving,
            inside=inside,
            before=acted.before,
            checked=s.checked | (s.act == Act.CHECK),
            crossing=s.crossing | crossing,
            pushes=s.pushes + (s.act == Act.PUSH),
        )

    act = jnp.where(state.crossing | ~_in_contact(found, free, options).any(), Act.CHECK, Act.SOLVE)
    act = jnp.where(found.known.any(), act, Act.END)  # the body is far from all vertices: nothing to do
    no, unknown = jnp.array(False), (none, jnp.int32(0))
    start = _Round(act.astype(jnp.int32), still, nobody, nobody, unknown, no, no, jnp.int32(0))
    last = jax.lax.while_loop(lambda s: s.act != Act.END, one, start)
    return jax.lax.cond(
        last.moving.any(),
        lambda: _told(P, free, last, surface, options),
        lambda: _no_contact_result(V, P, finite, free, last, state, surface, options),
    )


class Act(IntEnum):
    """What a round of a frame does before contacts are put on their side of the body."""

    CHECK = 0  # nothing: the first contacts are
    SOLVE = 1
    PUSH = 2  # out of another part of the body, what has been pushed into it
    END = 3


class _Acted(NamedTuple):
    """A round before contacts are put on their side."""

    end: End
    moving: jax.Array  # as in `_Round`
    asked: jax.Array  # [n] bool, contacts whose side is not known
    before: tuple[jax.Array, jax.Array]


class _Round(NamedTuple):
    """The carry of a frame's rounds.

    Most frames have one: a solve that takes the nearest sheets' word for the sides, and a check at its end.
    Where that finds a vertex on the other side, as in the frame before, the first contacts are checked and
    the solve is done again.
    """

    act: jax.Array  # [] int32, the next `Act`
    end: End
    moving: jax.Array  # [n] bool; nobody where there is nothing to solve
    inside: jax.Array  # [n] bool, those of them that ended inside
    before: tuple[jax.Array, jax.Array]  # as `_depth`, of the frame as it came
    checked: jax.Array  # [] bool, the first contacts are on their side
    crossing: jax.Array  # [] bool, as in `CollisionState`
    pushes: jax.Array  # [] int32


@noinline
def _in_contact(first: Contacts, free: Bool[Array, " n"], options: CollisionOptions) -> Bool[Array, " n"]:
    """Return the vertices within the margin, and all that are inside."""
    return free & first.known & (first.ds < jnp.maximum(options.eps * (1 - options.slack), 0.0))


@noinline
def _told(
    P: Float[Array, "3 n"],
    free: Bool[Array, " n"],
    last: _Round,
    surface: PosedSurface,
    options: CollisionOptions,
) -> tuple[CollisionResult, CollisionState]:
    """Return the result of a frame that was solved, and the state for the next one."""
    end, moving = last.end, last.moving[None]
    P = jnp.where(moving, P + end.x, P)
    walls = _walls(end.at, free, surface.origin, options)
    following = CollisionState(
        triangle=end.at.triangle,
        V=P,
        collider=collider_of(surface),
        outside=~end.at.known | (end.at.ds >= 0),
        correction=jnp.where(moving, end.x, 0.0),
        crossing=last.crossing,
    )
    return CollisionResult(V=P.T, **_figures(last.before, end, free, options), planes=walls), following


@noinline
def _no_contact_result(
    V: Float[Array, "n 3"],
    P: Float[Array, "3 n"],
    finite: Bool[Array, ""],
    free: Bool[Array, " n"],
    last: _Round,
    state: CollisionState,
    surface: PosedSurface,
    options: CollisionOptions,
) -> tuple[CollisionResult, CollisionState]:
    """Return result and next state of a frame without contacts; keeps the old state on non-finite input."""
    none, count, first = jnp.zeros((), P.dtype), jnp.int32(0), last.end.at
    outcome = jnp.where(finite, jnp.int32(Outcome.NOTHING_TO_DO), jnp.int32(Outcome.NOT_FINITE))
    result = CollisionResult(
        V=V,
        deepest_before=none,
        deepest_after=none,
        penetrating_before=count,
        penetrating_after=count,
        steps=count,
        objective=none,
        converged=finite,
        outcome=outcome,
        planes=_walls(first, free, surface.origin, options),
    )
    following = CollisionState(
        triangle=first.triangle,
        V=P,
        collider=collider_of(surface),
        outside=jnp.ones_like(state.outside),
        correction=jnp.zeros_like(P),
        crossing=last.crossing,
    )
    return result, chosen(finite, following, state)


@noinline
def _figures(
    before: tuple[Array, Array], end: End, free: Bool[Array, " n"], options: CollisionOptions
) -> dict[str, Array]:
    """Return all of `CollisionResult` but the garment and the planes; `before` as `_depth`."""
    deepest, after = _depth(end.at, free)
    lowest = jnp.where(free & end.at.known, end.at.ds, jnp.inf).min()
    outside = jnp.where(end.moved <= options.tolerance, Outcome.CONVERGED, Outcome.STEPS_SPENT)
    missed = jnp.where(lowest >= 0, Outcome.MARGIN_MISSED, Outcome.STILL_INSIDE)
    kept = lowest >= options.eps * (1 - options.slack)
    outcome = jnp.where(kept, outside, missed).astype(jnp.int32)
    return {
        "deepest_before": before[0],
        "deepest_after": deepest,
        "penetrating_before": before[1],
        "penetrating_after": after,
        "steps": end.steps,
        "objective": end.objective,
        "converged": outcome == Outcome.CONVERGED,
        "outcome": outcome,
    }


def free_vertices(n: int, pins: Int[Array | np.ndarray, " p"] | None) -> Bool[Array | np.ndarray, " n"]:
    """Return which of `n` vertices are not pinned; on the host where the pins are."""
    if pins is None or isinstance(pins, np.ndarray):
        return ~np.isin(np.arange(n), [] if pins is None else pins)
    return jnp.ones(n, bool).at[pins].set(False)


def check_pins(pins: Int[Array | np.ndarray, " p"] | None, pin_positions: Array | np.ndarray | None) -> None:
    """Raise `ValueError` unless both are None or there are as many positions `[p, 3]` as pins."""
    if pins is None or pin_positions is None:
        if pins is pin_positions:
            return
        given, missing = ("pins", "pin_positions") if pin_positions is None else ("pin_positions", "pins")
        raise ValueError(f"{given} came without {missing}; give both, or neither where nothing is pinned.")
    if jnp.shape(pin_positions) != (len(pins), 3):
        raise ValueError(
            f"pin_positions is {list(jnp.shape(pin_positions))} for {len(pins)} pins; "
            f"give [{len(pins)}, 3], a position for each."
        )


@noinline
def _placed(
    V_f: Float[Array, "n 3"],
    pins: Int[Array | np.ndarray, " p"] | None,
    pin_positions: Float[Array, "p 3"] | None,
    surface: PosedSurface,
) -> tuple[Array, Array, Array, Array]:
    """Return the garment with pins `[n, 3]`, `[3, n]`, from the surface's origin, and if all is finite."""
    V = V_f if pins is None else V_f.at[pins].set(pin_positions)
    P = fusion_barrier(V.T)  # or each that reads it turns it anew
    finite = jnp.isfinite(P).all() & jnp.isfinite(surface.origin).all()  # the origin: a mean of the body
    return V, P, P - surface.origin[:, None], finite


@noinline
def _first_contacts(
    P: Float[Array, "3 n"],
    local: Float[Array, "3 n"],
    free: Bool[Array, " n"],
    finite: Bool[Array, ""],
    state: CollisionState,
    surface: PosedSurface,
    tables: CollisionTables,
    options: CollisionOptions,
) -> Contacts:
    """Return the contacts of a garment, searched for as far as they may be."""
    grouped = coordinates_of(tables.groups.T, local.reshape(-1))
    moved, its = P - state.V, collider_of(surface) - state.collider
    crossed = crossing_limit(grouped, moved, its, surface, tables)
    # the margin, or what may have crossed the surface since the last frame
    limit = jnp.where(state.outside, jnp.maximum(crossed, options.eps + options.reach), jnp.inf)
    limit = jnp.where(free & finite, limit, -1.0)
    return find_contacts(local, grouped, state.triangle, limit, surface, tables)


@noinline
def _depth(at: Contacts, counted: Bool[Array, " n"]) -> tuple[Array, Array]:
    """Return the deepest penetration (metres) and how many vertices are inside."""
    inside = counted & at.known & (at.ds < 0)
    return jnp.where(inside, -at.ds, 0.0).max(), inside.sum().astype(jnp.int32)


@noinline
def _walls(
    at: Contacts, free: Bool[Array, " n"], origin: Float[Array, "3"], options: CollisionOptions
) -> Planes:
    """Return what keeps the free vertices outside by the margin, in the frame of the input."""
    direction = jnp.where((free & at.known)[None], at.direction, 0.0)
    return Planes(direction, dot(at.point + origin[:, None], direction) + options.eps)


@noinline
def _begun(
    contact: Bool[Array, " n"],
    free: Bool[Array, " n"],
    correction: Float[Array, "3 n"],
    tables: CollisionTables,
    options: CollisionOptions,
) -> tuple[Members, Array]:
    """Return what moves, and from where."""
    moving = dilate(contact, tables, options.rings) & free
    return find_members(moving, tables), jnp.where(moving[None], correction, 0.0)
