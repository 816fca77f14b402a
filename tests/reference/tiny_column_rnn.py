"""A column RNN of the tiny scene (128 vertices), with parameters that move the cloth."""

import dataclasses
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.config import ColumnRnnConfig
from garment_jax.dataset.template import ColumnTables
from garment_jax.model.column_rnn.motion import column_frames
from garment_jax.model.column_rnn.network import init_column_rnn
from garment_jax.model.column_rnn.tables import make_column_tables
from garment_jax.model.store import Model
from garment_jax.structs import ColumnFrame, Motion
from tests.animation.tiny_model import SCENE, drawn, tiny_model
from tests.reference.scene import make_motion

COLUMNS = ColumnRnnConfig(
    steps=8, columns=8, rows=3, hidden=6, width=8, around=3, layers=1, window=5, lanes=2, lane_windows=3
)


@lru_cache(maxsize=1)
def tables() -> ColumnTables:
    """Return the static tables."""
    return make_column_tables(SCENE, config=COLUMNS)


@lru_cache(maxsize=1)
def params() -> dict:
    """Return parameters drawn at random: the cloth swings by centimetres."""
    shapes = jax.eval_shape(lambda: init_column_rnn(jax.random.key(0), config=COLUMNS))
    rng = np.random.default_rng(3)
    further = ("before_0", "after_0")
    made = {name: part for name, part in shapes.items() if name not in further}
    made = jax.tree.map(lambda leaf: drawn(rng, leaf.shape), made)
    for name in further:  # as large as the others they would throw the cloth about
        made[name] = jax.tree.map(lambda leaf: 0.3 * drawn(rng, leaf.shape), shapes[name])
    return made


def column_rnn_model(base: Model | None = None) -> Model:
    """Return the tiny model, or another one of its garment, with a column RNN beside its latents."""
    model = base or tiny_model()
    config = dataclasses.replace(model.config, column_rnn=COLUMNS)
    return model._replace(config=config, params={**model.params, "column_rnn": params()})


def motion(t: int) -> Motion:
    """Return the tiny motion."""
    return make_motion(SCENE, t)


def frames(t: int) -> ColumnFrame:
    """Return the frames of the tiny motion as the ring takes them."""
    return jax.tree.map(jnp.asarray, column_frames(motion(t), SCENE, tables()))
