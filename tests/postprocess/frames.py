"""Post-processing of the square cloth over the closed surface, for the tests."""

import jax.numpy as jnp
import numpy as np

from garment_jax.postprocess.collision import CollisionOptions
from garment_jax.postprocess.pipeline import BodyFrame
from garment_jax.postprocess.tables import ContactTables
from tests.postprocess.collision.cloth import tables


def contact_tables(pins: np.ndarray, options: CollisionOptions) -> ContactTables:
    """Return the sheet's tables, without limbs and without a care for its edges."""
    made = tables()[0]
    free = ~np.isin(np.arange(len(made.index)), pins)
    left_out = {"crossings": None, "strain": None, "untangle": None}
    return ContactTables(pins, free, collision=made, options=options, **left_out)


def body_frames(pins: np.ndarray, collider: np.ndarray) -> BodyFrame:
    """Return frames without limbs; `pins` `[k, p, 3]`, `collider` `[k, c, 3]` metres."""
    return BodyFrame(jnp.asarray(pins), jnp.asarray(collider), jnp.zeros((len(pins), 0, 2, 3)))
