"""What the lanes of the swing's stage read."""

import jax
import numpy as np

from garment_jax.data.lanes import LaneWindow
from garment_jax.swing.mirror import mirrored_cells, mirrored_frames
from garment_jax.training.swing_stage import _Clip, make_batch
from tests.reference.tiny_swing import SWING, frames, tables

N, W = 9, 4


def clip(scale: float) -> _Clip:
    made = _Clip.__new__(_Clip)
    made.frames = jax.tree.map(np.asarray, frames(N))
    rest = np.asarray(tables().rest)
    made.X = (rest * (1.0 + scale * np.arange(N)[:, None, None, None])).astype(np.float32)
    return made


def test_numbers_beyond_the_clips_are_the_mirrored_ones() -> None:
    clips = [clip(0.01), clip(0.02)]
    lanes = LaneWindow(
        np.array([1, 3, 2]),
        np.array([2, 2, 0]),
        np.array([True, True, False]),
        np.ones(3, bool),
        np.zeros(3, int),
    )
    batch = make_batch(clips, lanes, tables(), W)
    cut = jax.tree.map(lambda leaf: leaf[2 : 2 + W], clips[1].frames)
    for place, frame, X in (
        (0, cut, clips[1].X[1 : 2 + W]),
        (1, mirrored_frames(cut), mirrored_cells(clips[1].X[1 : 2 + W])),
    ):
        for leaf, wanted in zip(batch.frame, frame, strict=True):
            np.testing.assert_array_equal(leaf[:, place], wanted)
        np.testing.assert_array_equal(batch.X_start[place], X[0])
        np.testing.assert_array_equal(batch.X_star[:, place], X[1:])
    np.testing.assert_array_equal(batch.X_star[:, 2], mirrored_cells(clips[0].X[:W]))
    np.testing.assert_array_equal(batch.X_start[2], tables().rest)  # nothing before a first frame
    assert batch.X_star.shape == (W, 3, SWING.columns, SWING.rows, 3)
