"""The order of what happens to a frame after the networks: `step`, one frame in, one frame out.

    pins -> strain limit -> edge lengths                             `shape_step`
    limb crossings -> self-crossings -> collision -> stretched again -> rest   `contact_step`

Nothing here is fed back into the networks. The two halves are steps of their own, since a rollout computes
them on two threads, and `garment-jax collide` does the second alone. Metres, root frames.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.geometry.strain_limit import strain_limited
from garment_jax.postprocess.collision.projection import initial_state
from garment_jax.postprocess.collision.result import CollisionResult, CollisionState, Outcome, chosen, joined
from garment_jax.postprocess.collision.solver import resolve_collisions
from garment_jax.postprocess.collision.tightening import resolve_unstretched
from garment_jax.postprocess.edge_lengths import LengthState, init_lengths, restore_lengths
from garment_jax.postprocess.figures import FrameFigures, correction_of
from garment_jax.postprocess.limb_crossings import (
    CrossingState,
    after_collisions,
    init_crossings,
    undo_crossings,
)
from garment_jax.postprocess.pins import attach
from garment_jax.postprocess.rest import (
    RestState,
    at_rest,
    freeze,
    init_rest,
    next_rest,
)
from garment_jax.postprocess.tables import ContactTables, ShapeTables
from garment_jax.postprocess.untangling import UntangleState, faded, grown, init_untangle, untangle

ROUNDS = 4  # of undoing self-crossings and pushing out of the body, in a frame
LATE = 12  # more, where that was not enough


class BodyFrame(NamedTuple):
    """What the body carries in one frame."""

    pins: jax.Array  # [p, 3] metres, root frame
    collider: jax.Array  # [c, 3]
    bones: jax.Array  # [q, 2, 3] ends of the limbs' bones


class ShapeState(NamedTuple):
    """What `shape_step` hands to the next frame."""

    lengths: LengthState


class ContactState(NamedTuple):
    """What `contact_step` hands to the next frame."""

    collision: CollisionState
    correction: jax.Array  # [n, 3] metres, of the last frame
    begun: jax.Array  # [] bool: there was a last frame
    rest: RestState
    crossings: CrossingState | None
    untangle: UntangleState | None


def shape_init(V: Float[Array, "n 3"], frame: BodyFrame, *, tables: ShapeTables) -> ShapeState:
    """Return the state before the first frame."""
    return ShapeState(init_lengths(len(V)))


def shape_step(
    state: ShapeState, V: Float[Array, "n 3"], frame: BodyFrame, *, tables: ShapeTables
) -> tuple[ShapeState, Float[Array, "n 3"], None]:
    """Return the next state, and `V` at its pins with its edges near their lengths."""
    V = attach(V, frame.pins, pins=tables.pins, extension=tables.extension)
    V, _ = strain_limited(V, tables.strain)
    if tables.lengths is None:
        return state, V, None
    free = jnp.asarray(tables.free)
    lengths, V, _ = restore_lengths(state.lengths, V, free=free, tables=tables.lengths)
    return ShapeState(lengths), V, None


def contact_init(V: Float[Array, "n 3"], frame: BodyFrame, *, tables: ContactTables) -> ContactState:
    """Return the state before the first frame, whose garment is on its side of every limb."""
    return ContactState(
        collision=initial_state(V, frame.collider, tables.collision.surface),
        correction=jnp.zeros_like(V),
        begun=jnp.array(False),
        rest=init_rest(V, frame.collider),
        crossings=None if tables.crossings is None else init_crossings(V, frame.bones),
        untangle=None if tables.untangle is None else init_untangle(tables.untangle),
    )


def contact_step(
    state: ContactState, V_f: Float[Array, "n 3"], frame: BodyFrame, *, tables: ContactTables
) -> tuple[ContactState, Float[Array, "n 3"], FrameFigures]:
    """Return the next state, `V_f` outside the body and on its side of the limbs, and what that took."""
    frames, kept = at_rest(state.rest, V_f, frame.collider)
    rest, undo = state.rest, lambda: (state.crossings, V_f, jnp.int32(0))
    if tables.crossings is not None and state.crossings is not None:
        follow = partial(undo_crossings, free=jnp.asarray(tables.free), tables=tables.crossings)
        undo = partial(follow, state.crossings, V_f, frame.bones)
    crossings, V, pierced = jax.lax.cond(
        kept, lambda: (state.crossings, V_f + rest.correction, rest.pierced), undo
    )
    itself, crossed, result, collision = _apart(state, V, V_f, frame, kept, tables)
    result, collision = freeze(result, collision, V, kept)
    correction, pop = correction_of(result.V, V_f, state.correction, state.begun, tables.free)
    if crossings is not None:
        crossings = after_collisions(crossings, result.V, correction, (pierced > 0) & ~kept)
    found = RestState(
        V_f=V_f,
        # what is inside for ever is pushed anew in every frame, not ever farther
        correction=jnp.where(kept & (result.outcome == Outcome.STILL_INSIDE), V - V_f, correction),
        collider=frame.collider,
        frames=frames,
        deepest=result.deepest_before,
        penetrating=result.penetrating_before,
        outcome=result.outcome,
        pierced=pierced,
    )
    rest, outcome = next_rest(rest, found, kept)
    figures = FrameFigures(
        deepest_before=rest.deepest,
        deepest_after=result.deepest_after,
        penetrating_before=rest.penetrating,
        penetrating_after=result.penetrating_after,
        steps=result.steps,
        outcome=outcome,
        pierced=pierced,
        pop=pop,
        self_crossings=crossed,
    )
    following = ContactState(collision, correction, jnp.array(True), rest, crossings, itself)
    return following, result.V, figures


def _apart(
    state: ContactState,
    V: Float[Array, "n 3"],
    V_f: Float[Array, "n 3"],
    frame: BodyFrame,
    kept: Array,
    tables: ContactTables,
) -> tuple[UntangleState | None, Array, CollisionResult, CollisionState]:
    """Return `V` apart from itself and from the body, and how many edges still go through a face.

    Both at first by the last frame's weights, without a look at what crosses: mostly that is enough. Else,
    and since what is pushed out of the body may be pushed into itself, again, a few times. Where that does
    not end it, as where the body pushes one layer into another, late rounds begin with what the body has
    pushed; the next frame gets nothing of theirs. The round after which least crosses counts. A correction
    that is `kept` is part of `V` already.
    """
    own = tables.untangle
    if own is None or state.untangle is None:
        return state.untangle, jnp.int32(0), *_resolved(state.collision, V, V_f, frame, kept, tables)

    def attempt(carry: tuple[Any, ...]) -> tuple[Any, ...]:
        (itself, _, last, _), rounds, best = carry
        late = rounds >= ROUNDS
        at, given = chosen(late, (last.V, init_untangle(own)), (V, itself))
        given, x, _ = jax.lax.cond(
            kept, lambda: (given, V, jnp.int32(0)), lambda: untangle(given, at, own, look=rounds > 0)
        )
        result, collision = _resolved(state.collision, x, V_f, frame, kept, tables)
        result = joined(last, result, first=rounds == 0)
        by = chosen(late, itself, given)
        more, left = jax.lax.cond(
            kept, lambda: (by, jnp.int32(0)), lambda: grown(by, result.V, own, flatten=rounds > 0)
        )
        found = chosen(late, by, more), left, result, collision
        return found, rounds + 1, chosen((rounds == 0) | (left < best[1]), (by, *found[1:]), best)

    shapes = jax.eval_shape(lambda: _resolved(state.collision, V, V_f, frame, kept, tables))
    zeros = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
    begin = faded(state.untangle), jnp.int32(1), *zeros
    _, _, (itself, crossed, result, collision) = jax.lax.while_loop(
        lambda carry: (carry[0][1] > 0) & (carry[1] < ROUNDS + LATE), attempt, (begin, jnp.int32(0), begin)
    )
    return chosen(kept, state.untangle, itself), crossed, result, collision


def _resolved(
    state: CollisionState,
    V: Float[Array, "n 3"],
    V_f: Float[Array, "n 3"],
    frame: BodyFrame,
    kept: Array,
    tables: ContactTables,
) -> tuple[CollisionResult, CollisionState]:
    """Return `V` resolved, and shortened where it is more stretched than `V_f`.

    A correction that is `kept` is part of `V` already: the solver begins without it, and hands it on.
    """
    resolve = resolve_collisions
    if tables.strain is not None:
        resolve = partial(resolve_unstretched, strain=tables.strain, as_in=V_f)
    result, following = resolve(
        V,
        frame.collider,
        state._replace(correction=jnp.where(kept, 0.0, state.correction)),
        tables=tables.collision,
        pins=tables.pins,
        pin_positions=frame.pins,
        options=tables.options,
    )
    return result, following._replace(correction=jnp.where(kept, state.correction, following.correction))
