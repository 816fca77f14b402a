"""A body that stands still: hanging cloth keeps what its contacts have made of it.

Every frame the solver starts from the last answer and ends where its steps run out, so that where parts of
the body cross each other, or cloth is caught, the garment trembles by up to centimetres for ever. Simulated
cloth does not: once the body and the prediction have come to rest, the correction may rest, too. Not in the
paper.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from garment_jax.collision.result import CollisionResult, CollisionState, Outcome
from garment_jax.geometry.apart import apart

STILL = 1e-4  # metres: a body whose vertices stay within this of where they were stands
SETTLE = 15  # frames of a standing body that are resolved as any other: folds come to rest
QUIET = 1e-3  # metres a frame: a prediction whose vertices all move by less hangs


class Standing(NamedTuple):
    """What the frames of a standing body go on from."""

    V_f: jax.Array  # [n, 3] metres, the last prediction
    correction: jax.Array  # [n, 3] metres, what was added to it
    collider: jax.Array  # [c, 3] metres, the body where it came to stand
    frames: jax.Array  # [] int32 since then
    deepest: jax.Array  # [] metres inside the collider, before the last frame that was resolved as any other
    penetrating: jax.Array  # [] int32 vertices inside before
    outcome: jax.Array  # [] int32, its `Outcome`
    pierced: jax.Array  # [] int32 bones through its prediction


def nobody_stands(V_f: Float[Array, "n 3"], collider: Float[Array, "c 3"]) -> Standing:
    """Return what goes before the first frame."""
    none = jnp.int32(0)
    return Standing(V_f, jnp.zeros_like(V_f), collider, none, jnp.zeros((), V_f.dtype), none, none, none)


def standing_frames(standing: Standing, collider: Float[Array, "c 3"]) -> Int[Array, ""]:
    """Return for how many frames the body stands where it is now (metres, root frame); 0 if it moves."""
    stands = (jnp.abs(collider - standing.collider) <= STILL).all()
    return jnp.where(stands, standing.frames + 1, 0)


def keeps(standing: Standing, V_f: Float[Array, "n 3"], frames: Int[Array, ""]) -> Bool[Array, ""]:
    """Return whether a frame keeps the correction of the last one: the body stands, and the cloth hangs.

    `V_f` is the frame's prediction (metres, root frame). One with a NaN keeps nothing.
    """
    squared = jnp.square(V_f - standing.V_f).sum(axis=-1)
    return (frames > SETTLE) & (squared < QUIET**2).all()


@apart
def stood(standing: Standing, found: Standing, kept: Bool[Array, ""]) -> Standing:
    """Return what follows a frame `found` so; one that `kept` the correction says of before what is known."""
    known = found._replace(
        deepest=standing.deepest,
        penetrating=standing.penetrating,
        outcome=standing.outcome,
        pierced=standing.pierced,
    )
    new = jax.tree.map(lambda old, now: jnp.where(kept, old, now), known, found)
    return new._replace(collider=jnp.where(found.frames > 0, standing.collider, found.collider))


@apart
def calmed(
    result: CollisionResult, state: CollisionState, held: Float[Array, "n 3"], kept: Bool[Array, ""]
) -> tuple[CollisionResult, CollisionState]:
    """Return the cloth as it was `held` where that was `kept` and not inside, and pushing it found no rest.

    Between parts of the body that touch there is no room for the margin: pushed out of one the cloth is too
    near to the other, and would jump to and fro.
    """
    calm = kept & (result.outcome == Outcome.MARGIN_MISSED) & (result.penetrating_before == 0)
    calm_state = state._replace(V=held.T, outside=jnp.ones_like(state.outside))
    V = jnp.where(calm, held, result.V)
    return result._replace(V=V), jax.tree.map(lambda a, b: jnp.where(calm, a, b), calm_state, state)
