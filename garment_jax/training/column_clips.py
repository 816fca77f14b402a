"""Frames that the column RNN learns: what its columns see of a clip's motion, and where its cells hang.

All clips lie one after the other on the device, and a batch is cut out of them there.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from garment_jax.dataset.batches import ALL
from garment_jax.dataset.lanes import LaneWindow
from garment_jax.dataset.prepared import DataSet, PreparedClip, frames_of
from garment_jax.dataset.template import ColumnTables
from garment_jax.farm.local import LocalFarm, in_order
from garment_jax.model.column_rnn.motion import column_frames
from garment_jax.model.column_rnn.network import cells_of
from garment_jax.model.column_rnn.train_step import ColumnBatch
from garment_jax.structs import ColumnFrame

CHUNK = 256  # frames of a clip whose cells are found at a time


class ColumnClip(NamedTuple):
    """A clip as the ring learns it; `t` frames. Or several, one after the other."""

    frames: ColumnFrame  # leaves [t, ...]
    X: np.ndarray | jax.Array  # [t, a, h, 3] cells, metres from the anchors, columns' frames


_cells = jax.jit(lambda V, anchor, tables: cells_of(V, anchor, tables=tables))


def column_clips(
    clips: Sequence[PreparedClip], data: DataSet, tables: ColumnTables, *, workers: int = 1
) -> list[ColumnClip]:
    """Return clips, mirror images among them, as the ring learns them."""
    # without all clips, for each of which it may go to another process
    cut = partial(_column_clip, data=data._replace(train=[], validation=[]), tables=tables)
    return in_order(LocalFarm(workers), cut, clips)


def _column_clip(clip: PreparedClip, *, data: DataSet, tables: ColumnTables) -> ColumnClip:
    frames, t, pieces = column_frames(clip.motion, data.scene, tables), len(clip.V), []
    arrays = tables._replace(carried=None)
    for start in range(0, t, CHUNK):
        which = np.minimum(np.arange(start, start + CHUNK), t - 1)  # one compiled length
        pieces.append(np.asarray(_cells(frames_of(clip, which, data), frames.anchor[which], arrays)))
    return ColumnClip(frames, np.concatenate(pieces)[:t])


def batches(
    clips: Sequence[ColumnClip],
    schedule: Sequence[LaneWindow],
    rest: np.ndarray,
    window: int,
    *,
    rows: slice = ALL,
) -> Callable[[int], ColumnBatch]:
    """Return step -> the frames that the lanes `rows` see in their windows.

    Before a clip cells hang at `rest`.
    """
    leaves = (jnp.asarray(np.concatenate(leaf)) for leaf in zip(*(c.frames for c in clips), strict=True))
    whole = ColumnClip(ColumnFrame(*leaves), jnp.asarray(np.concatenate([clip.X for clip in clips])))
    first = np.concatenate([[0], np.cumsum([len(clip.X) for clip in clips])])

    @jax.jit
    def cut(clips: ColumnClip, at: Int[Array, " L"], begins: Bool[Array, " L"]) -> tuple:
        which = at[None] + jnp.arange(window)[:, None]
        # a clip's first frame has none before it: there the template hangs, as in a rollout
        X_start = jnp.where(begins[:, None, None, None], rest, clips.X[jnp.maximum(at - 1, 0)])
        return *jax.tree.map(lambda leaf: leaf[which], clips), X_start

    def batch_at(step: int) -> ColumnBatch:
        lanes = schedule[step].part(rows)
        begins = lanes.start == 0
        frames, X_star, X_start = cut(whole, first[lanes.clip] + lanes.start, begins)
        return ColumnBatch(frames, X_star, lanes.fresh, X_start, lanes.fresh & ~begins)

    return batch_at
