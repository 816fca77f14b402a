"""A swing of the tiny scene (128 vertices), with parameters that move the cloth."""

import dataclasses
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.config import SwingConfig
from garment_jax.dataset.template import SwingTables
from garment_jax.model.column_rnn.motion import swing_frames
from garment_jax.model.column_rnn.network import init_swing
from garment_jax.model.column_rnn.tables import make_swing_tables
from garment_jax.model.store import Model
from garment_jax.structs import Motion, SwingFrame
from tests.animation.tiny_model import SCENE, drawn, tiny_model
from tests.reference.scene import make_motion

SWING = SwingConfig(
    steps=8, columns=8, rows=3, hidden=6, width=8, around=3, layers=1, window=5, lanes=2, lane_windows=3
)


@lru_cache(maxsize=1)
def tables() -> SwingTables:
    """Return the static tables."""
    return make_swing_tables(SCENE, config=SWING)


@lru_cache(maxsize=1)
def params() -> dict:
    """Return parameters drawn at random: the cloth swings by centimetres."""
    shapes = jax.eval_shape(lambda: init_swing(jax.random.key(0), config=SWING))
    rng = np.random.default_rng(3)
    further = ("before_0", "after_0")
    made = {name: part for name, part in shapes.items() if name not in further}
    made = jax.tree.map(lambda leaf: drawn(rng, leaf.shape), made)
    for name in further:  # as large as the others they would throw the cloth about
        made[name] = jax.tree.map(lambda leaf: 0.3 * drawn(rng, leaf.shape), shapes[name])
    return made


def swinging_model(base: Model | None = None) -> Model:
    """Return the tiny model, or another one of its garment, with a swing beside its codes."""
    model = base or tiny_model()
    config = dataclasses.replace(model.config, swing=SWING)
    return model._replace(config=config, params={**model.params, "swing": params()})


def motion(t: int) -> Motion:
    """Return the tiny motion."""
    return make_motion(SCENE, t)


def frames(t: int) -> SwingFrame:
    """Return the frames of the tiny motion as the ring takes them."""
    return jax.tree.map(jnp.asarray, swing_frames(motion(t), SCENE, tables()))
