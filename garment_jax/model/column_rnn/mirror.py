"""The ring beside its mirror image: in a rollout both go on from the mean of their cells.

Not in the paper. A ring that has learnt clips and their mirror images gives two answers to a frame: its own,
and its answer to the mirrored motion, mirrored back. What differs between them is error. Both take the same
cells into the next frame, so they never part, and their mean moves as much as either.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.config import Config
from garment_jax.dataset.template import ColumnTables
from garment_jax.model.column_rnn.motion import FEATURES, OFFSET
from garment_jax.structs import ColumnFrame

AROUND = (1, 4, 7)  # of a column's features: the way around, which the mirror turns


def is_mirrored(config: Config) -> bool:
    """Return whether rollouts take the mirror image in: wanted, and learnt."""
    return config.rollout.mirrored and config.data.mirror


def reflected(x: Float[Array, "*b a h 3"]) -> Float[Array, "*b a h 3"]:
    """Return vectors of the columns' frames as the mirror x = 0 shows them."""
    return _reversed(x, -3) * _sign(x, (1,))


def agreed(X: Float[Array, "*b 2 a h 3"]) -> Float[Array, "*b 2 a h 3"]:
    """Return the mean of a ring's cells and its mirror image's, for both."""
    return with_image(0.5 * (X[..., 0, :, :, :] + reflected(X[..., 1, :, :, :])))


def with_image(x: Float[Array, "*b a h 3"]) -> Float[Array, "*b 2 a h 3"]:
    """Return vectors of the columns' frames and their mirror images."""
    return jnp.stack([x, reflected(x)], axis=-4)


def frame_with_image(frame: ColumnFrame, tables: ColumnTables) -> ColumnFrame:
    """Return a frame `[*b, ...]` with its mirror image, `[*b, 2, ...]`; the anchors stay alone."""
    seen, way, turn = (jnp.asarray(leaf) for leaf in (frame.seen, frame.way, frame.turn))
    # the offsets are told from where the template's anchors are, which need not be symmetric
    centre = jnp.asarray(tables.centre)[:, None]
    shift = (reflected(centre) - centre)[:, 0] / OFFSET
    shift = jnp.pad(shift, ((0, 0), (0, FEATURES - 3)))
    image = _reversed(seen, -2) * _sign(seen, AROUND) + jnp.broadcast_to(shift, seen.shape)
    return frame._replace(
        seen=jnp.stack([seen, image], axis=-3),
        way=jnp.stack([way, reflected(way[..., None, :])[..., 0, :]], axis=-3),
        turn=jnp.stack([turn, -turn], axis=-1),
    )


def own(X: Float[Array, "*b a h 3"], mirrored: bool) -> Float[Array, "*c a h 3"]:
    """Return the ring's own cells, without its mirror image's."""
    return X[..., 0, :, :, :] if mirrored else X


def _reversed(x: jax.Array, axis: int) -> jax.Array:
    """Return the columns the other way round, the first in its place."""
    return jnp.roll(jnp.flip(x, axis), 1, axis)


def _sign(x: jax.Array, negated: tuple[int, ...]) -> jax.Array:
    """Return ones in the shape of `x`, minus ones in the components `negated`."""
    return jnp.broadcast_to(jnp.ones(x.shape[-1]).at[jnp.array(negated)].set(-1.0), x.shape)
