"""The column RNN in a rollout: the ring rolled out beside the latents, whose cloth it corrects."""

from collections.abc import Callable
from functools import partial
from operator import itemgetter

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.config import ColumnRnnConfig, Config
from garment_jax.dataset.lanes import repeated_last
from garment_jax.dataset.template import ColumnTables, Template
from garment_jax.model.column_rnn.motion import FEATURES, column_frames
from garment_jax.model.column_rnn.network import column_step, corrected, roll_columns, seen_gates
from garment_jax.structs import ColumnCarry, ColumnFrame, FrameInput, Motion, Scene


def column_frame(
    params: dict,
    carry: ColumnCarry,
    x: FrameInput,
    V: Float[Array, "*b n 3"],
    *,
    template: Template,
    config: Config,
) -> tuple[ColumnCarry, Float[Array, "*b n 3"]]:
    """Return the ring's next state and the latents' frame `V` (metres, root frame) as it corrects it.

    Nothing of the latents goes into the ring, so their errors do not add up. Raises `ValueError` for a frame
    that holds nothing for it.
    """
    frame = _seen(x)
    gates = seen_gates(params["column_rnn"], jnp.asarray(frame.seen), config=config.column_rnn)
    carry = column_step(
        params["column_rnn"], carry, frame, gates, tables=_ring(template), config=config.column_rnn
    )
    return carry, _drawn(V, carry.X, frame, template, config)


def column_frames_of(
    params: dict,
    carry: ColumnCarry,
    x: FrameInput,
    V: Float[Array, "t *b n 3"],
    *,
    template: Template,
    config: Config,
) -> tuple[ColumnCarry, Float[Array, "t *b n 3"]]:
    """Return `column_frame` of all frames: the ring's state after them, and the corrected frames."""
    frames = _seen(x)
    carry, X = roll_columns(
        params["column_rnn"], carry, frames, tables=_ring(template), config=config.column_rnn
    )

    def drawn(frame: tuple[jax.Array, jax.Array, ColumnFrame]) -> jax.Array:
        return _drawn(*frame, template, config)

    # all at once, the cells around each vertex of every motion side by side would fill the memory
    return carry, drawn((V, X, frames)) if V.ndim == 3 else jax.lax.map(drawn, (V, X, frames))


def _drawn(V: jax.Array, X: jax.Array, frame: ColumnFrame, template: Template, config: Config) -> jax.Array:
    weight = config.rollout.column_rnn
    return corrected(V, X, jnp.asarray(frame.anchor), tables=_ring(template), weight=weight)


def _ring(template: Template) -> ColumnTables:
    assert template.ring is not None  # `template_for` makes it where a model has a column RNN
    return template.ring


def _seen(x: FrameInput) -> ColumnFrame:
    if x.column_rnn is None:
        raise ValueError(
            "the model has a column RNN and its input nothing for it; take the input of model_input."
        )
    return x.column_rnn


def seen_in(scene: Scene, ring: ColumnTables, chunk: int, motion: Motion, start: int) -> ColumnFrame:
    """Return what the ring takes of a chunk of `motion` from `start` on, its last frame repeated (host)."""
    frames = column_frames(motion, scene, ring, slice(start, min(start + chunk, len(motion.root))))
    return ColumnFrame(*(repeated_last(np.asarray(leaf), chunk) for leaf in frames))


def unseen(ring: ColumnTables, chunk: int) -> ColumnFrame:
    """Return zeros in its shapes and types, to compile with."""
    a = len(ring.frames)
    shapes = (a, FEATURES), (a, 3), (), (a, 3)
    return ColumnFrame(*(np.zeros((chunk, *shape), np.float32) for shape in shapes))


def make_column_rollout(tables: ColumnTables, config: ColumnRnnConfig) -> Callable:
    """Return `roll_columns` jitted for one garment: (params, carry, frames) -> (carry, X)."""
    return jax.jit(partial(roll_columns, tables=tables, config=config))


def roll_clip(
    roll: Callable, params: dict, carry: ColumnCarry, frames: ColumnFrame, *, chunk: int
) -> np.ndarray:
    """Return the ring's cells in all `frames` `[t, ...]`, begun from `carry`: `[t, a, h, 3]` metres."""
    t, pieces = len(frames.turn), []
    for start in range(0, t, chunk):
        piece = jax.tree.map(itemgetter(slice(start, min(start + chunk, t))), frames)
        carry, X = roll(params, carry, ColumnFrame(*(repeated_last(leaf, chunk) for leaf in piece)))
        pieces.append(np.asarray(X))
    return np.concatenate(pieces)[:t]
