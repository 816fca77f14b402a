"""The swing in a rollout: the ring rolled out beside the codes, whose cloth it corrects chunk by chunk."""

from collections.abc import Callable, Iterator
from functools import partial
from operator import itemgetter
from typing import Any

import jax
import numpy as np

from garment_jax.config import SwingConfig
from garment_jax.data.lanes import repeated_last
from garment_jax.programs import ProgramStore, shapes_of
from garment_jax.structs import Motion, Scene
from garment_jax.swing.motion import FEATURES, SwingFrame, swing_frames
from garment_jax.swing.network import SwingCarry, at_rest, corrected, roll_swing
from garment_jax.swing.tables import SwingTables, make_swing_tables

# (motion, the codes' pieces) -> the same corrected: (first frame, V [chunk, n, 3] metres, root frames)
Corrector = Callable[[Motion, Iterator[tuple[int, jax.Array]]], Iterator[tuple[int, jax.Array]]]


def make_swing_corrector(
    params: dict,
    scene: Scene,
    *,
    config: SwingConfig,
    weight: float,
    gain: float,
    chunk: int,
    programs: ProgramStore,
    facts: dict[str, Any],
) -> Corrector:
    """Return the function that corrects rollouts by `weight` of the way to the ring's; compiles at once.

    Drawn out by `gain` after that. Nothing of the codes goes into the ring, so their errors do not add up.
    `params` are the swing's.
    """
    tables = make_swing_tables(scene, config=config)

    def run(
        params: dict, carry: SwingCarry, frames: SwingFrame, V: jax.Array
    ) -> tuple[SwingCarry, jax.Array]:
        carry, X = roll_swing(params, carry, frames, tables=tables, config=config)
        return carry, corrected(V, X, frames.anchor, tables=tables, weight=weight, gain=gain)

    a = config.columns
    shapes = SwingFrame((a, FEATURES), (a, 3), (), (a, 3))
    frames = SwingFrame(*(np.zeros((chunk, *shape), np.float32) for shape in shapes))
    V = np.zeros((chunk, len(scene.garment.template), 3), np.float32)
    example = shapes_of((params, at_rest(tables, (), config=config), frames, V))
    program = programs.program("swing", jax.jit(run), example, facts)

    def correct(motion: Motion, pieces: Iterator[tuple[int, jax.Array]]) -> Iterator[tuple[int, jax.Array]]:
        carry, t = at_rest(tables, (), config=config), len(motion.root)
        for start, V in pieces:
            seen = swing_frames(motion, scene, tables, slice(start, min(start + len(V), t)))
            seen = SwingFrame(*(repeated_last(leaf, len(V)) for leaf in seen))
            carry, V = program(params, carry, seen, V)
            yield start, V

    return correct


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
