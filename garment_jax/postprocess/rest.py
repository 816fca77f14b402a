"""Freeze the correction while the body and the predicted garment are at rest.

The solver starts every frame from the last answer and stops after a fixed number of steps. Where parts of
the body cross each other, or cloth is caught between them, it never converges and the garment jitters by up
to centimetres. Simulated cloth at rest does not move, so the last correction is kept. Not in the paper.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from garment_jax.geometry.noinline import noinline
from garment_jax.postprocess.collision.result import CollisionResult, CollisionState, Outcome, chosen

STILL = 1e-4  # metres: a body whose vertices stay within this of where they were stands
SETTLE = 15  # frames of a standing body that are resolved as any other: folds come to rest
QUIET = 1e-3  # metres a frame: a prediction whose vertices all move by less hangs


class RestState(NamedTuple):
    """What the frames of a standing body go on from."""

    V_f: jax.Array  # [n, 3] metres, the last prediction
    correction: jax.Array  # [n, 3] metres, what was added to it
    collider: jax.Array  # [c, 3] metres, the body where it came to stand
    frames: jax.Array  # [] int32 since then
    deepest: jax.Array  # [] metres inside the collider, before the last frame that was resolved as any other
    penetrating: jax.Array  # [] int32 vertices inside before
    outcome: jax.Array  # [] int32, its `Outcome`
    pierced: jax.Array  # [] int32 bones through its prediction


def init_rest(V_f: Float[Array, "n 3"], collider: Float[Array, "c 3"]) -> RestState:
    """Return what goes before the first frame: a body that has just come to stand."""
    none = jnp.int32(0)
    return RestState(V_f, jnp.zeros_like(V_f), collider, none, jnp.zeros((), V_f.dtype), none, none, none)


@noinline
def at_rest(
    state: RestState, V_f: Float[Array, "n 3"], collider: Float[Array, "c 3"]
) -> tuple[Int[Array, ""], Bool[Array, ""]]:
    """Return for how many frames the body stands (0: it moves), and whether this frame keeps the correction.

    It does where the body stands for longer than `SETTLE` and the prediction `V_f` hangs. A frame with a NaN
    keeps nothing. Metres, root frame.
    """
    stands = (jnp.abs(collider - state.collider) <= STILL).all()
    frames = jnp.where(stands, state.frames + 1, 0)
    squared = jnp.square(V_f - state.V_f).sum(axis=-1)
    return frames, (frames > SETTLE) & (squared < QUIET**2).all()


@noinline
def freeze(
    result: CollisionResult, state: CollisionState, held: Float[Array, "n 3"], kept: Bool[Array, ""]
) -> tuple[CollisionResult, CollisionState]:
    """Return the cloth as it was `held` where that was `kept` and not inside, and pushing it found no rest.

    Between parts of the body that touch there is no room for the margin: pushed out of one the cloth is too
    near to the other, and would jump to and fro.
    """
    frozen = kept & (result.outcome == Outcome.MARGIN_MISSED) & (result.penetrating_before == 0)
    frozen_state = state._replace(V=held.T, outside=jnp.ones_like(state.outside))
    V = jnp.where(frozen, held, result.V)
    return result._replace(V=V), chosen(frozen, frozen_state, state)


@noinline
def next_rest(state: RestState, found: RestState, kept: Bool[Array, ""]) -> tuple[RestState, Int[Array, ""]]:
    """Return what follows a frame `found` so, and its outcome.

    A frame that `kept` the correction says of before what is known; one that needs nothing more, of its
    outcome as well.
    """
    known = found._replace(
        deepest=state.deepest,
        penetrating=state.penetrating,
        outcome=state.outcome,
        pierced=state.pierced,
    )
    new = chosen(kept, known, found)
    new = new._replace(collider=jnp.where(found.frames > 0, state.collider, found.collider))
    nothing = kept & (found.outcome == Outcome.NOTHING_TO_DO)
    return new, jnp.where(nothing, jnp.minimum(new.outcome, Outcome.STEPS_SPENT), found.outcome)
