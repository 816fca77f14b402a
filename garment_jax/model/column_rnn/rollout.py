"""The swing in a rollout: the ring rolled out beside the codes, whose cloth it corrects."""

from collections.abc import Callable
from functools import partial
from operator import itemgetter

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.config import Config, SwingConfig
from garment_jax.dataset.lanes import repeated_last
from garment_jax.dataset.template import SwingTables, Template
from garment_jax.model.column_rnn.motion import FEATURES, swing_frames
from garment_jax.model.column_rnn.network import corrected, roll_swing, seen_gates, swing_step
from garment_jax.structs import FrameInput, Motion, Scene, SwingCarry, SwingFrame


def swing_frame(
    params: dict,
    carry: SwingCarry,
    x: FrameInput,
    V: Float[Array, "*b n 3"],
    *,
    template: Template,
    config: Config,
) -> tuple[SwingCarry, Float[Array, "*b n 3"]]:
    """Return the ring's next state and the codes' frame `V` (metres, root frame) as it corrects it.

    Nothing of the codes goes into the ring, so their errors do not add up. Raises `ValueError` for a frame
    that holds nothing for it.
    """
    frame = _seen(x)
    gates = seen_gates(params["swing"], jnp.asarray(frame.seen), config=config.swing)
    carry = swing_step(params["swing"], carry, frame, gates, tables=_ring(template), config=config.swing)
    return carry, _drawn(V, carry.X, frame, template, config)


def swing_frames_of(
    params: dict,
    carry: SwingCarry,
    x: FrameInput,
    V: Float[Array, "t *b n 3"],
    *,
    template: Template,
    config: Config,
) -> tuple[SwingCarry, Float[Array, "t *b n 3"]]:
    """Return `swing_frame` of all frames: the ring's state after them, and the corrected frames."""
    frames = _seen(x)
    carry, X = roll_swing(params["swing"], carry, frames, tables=_ring(template), config=config.swing)

    def drawn(frame: tuple[jax.Array, jax.Array, SwingFrame]) -> jax.Array:
        return _drawn(*frame, template, config)

    # all at once, the cells around each vertex of every motion side by side would fill the memory
    return carry, drawn((V, X, frames)) if V.ndim == 3 else jax.lax.map(drawn, (V, X, frames))


def _drawn(V: jax.Array, X: jax.Array, frame: SwingFrame, template: Template, config: Config) -> jax.Array:
    how = config.rollout
    drawn = {"weight": how.swing, "gain": how.gain, "reach": how.reach}
    return corrected(V, X, jnp.asarray(frame.anchor), tables=_ring(template), **drawn)


def _ring(template: Template) -> SwingTables:
    assert template.ring is not None  # `template_for` makes it where a model has a swing
    return template.ring


def _seen(x: FrameInput) -> SwingFrame:
    if x.swing is None:
        raise ValueError("the model has a swing and its input nothing for it; take the input of model_input.")
    return x.swing


def seen_in(scene: Scene, ring: SwingTables, chunk: int, motion: Motion, start: int) -> SwingFrame:
    """Return what the ring takes of a chunk of `motion` from `start` on, its last frame repeated (host)."""
    frames = swing_frames(motion, scene, ring, slice(start, min(start + chunk, len(motion.root))))
    return SwingFrame(*(repeated_last(np.asarray(leaf), chunk) for leaf in frames))


def unseen(ring: SwingTables, chunk: int) -> SwingFrame:
    """Return zeros in its shapes and types, to compile with."""
    a = len(ring.frames)
    shapes = (a, FEATURES), (a, 3), (), (a, 3)
    return SwingFrame(*(np.zeros((chunk, *shape), np.float32) for shape in shapes))


def make_swing_rollout(tables: SwingTables, config: SwingConfig) -> Callable:
    """Return `roll_swing` jitted for one garment: (params, carry, frames) -> (carry, X)."""
    return jax.jit(partial(roll_swing, tables=tables, config=config))


def roll_clip(
    roll: Callable, params: dict, carry: SwingCarry, frames: SwingFrame, *, chunk: int
) -> np.ndarray:
    """Return the ring's cells in all `frames` `[t, ...]`, begun from `carry`: `[t, a, h, 3]` metres."""
    t, pieces = len(frames.turn), []
    for start in range(0, t, chunk):
        piece = jax.tree.map(itemgetter(slice(start, min(start + chunk, t))), frames)
        carry, X = roll(params, carry, SwingFrame(*(repeated_last(leaf, chunk) for leaf in piece)))
        pieces.append(np.asarray(X))
    return np.concatenate(pieces)[:t]
