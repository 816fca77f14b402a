"""What the column RNN learns: cells against the weights of their vertices, batches against a loop."""

from dataclasses import replace

import numpy as np
import pytest

from garment_jax.dataset.lanes import make_schedule
from garment_jax.dataset.prepared import DataSet, prepare
from garment_jax.structs import ColumnFrame
from garment_jax.training.column_clips import ColumnClip, batches, column_clips
from tests.animation.tiny_model import CONFIG, SCENE
from tests.reference.scene import make_motion, write_clip
from tests.reference.tiny_column_rnn import tables


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> DataSet:
    folder = tmp_path_factory.mktemp("clips")
    write_clip(folder / "train" / "waltz.h5", scene=SCENE, motion=make_motion(SCENE, 12))
    (folder / "cache").mkdir()
    alone = replace(CONFIG, data=replace(CONFIG.data, validation=()))
    return prepare(folder, alone, folder / "cache", unposed=False)


def test_a_batch_is_what_a_loop_cuts_out() -> None:
    rng = np.random.default_rng(0)
    clips = []
    for t in (9, 6, 12):
        leaves = [rng.normal(size=(t, *s)).astype(np.float32) for s in ((8, 33), (8, 3), (), (8, 3))]
        clips.append(ColumnClip(ColumnFrame(*leaves), rng.normal(size=(t, 8, 3, 3)).astype("f4")))
    lengths, window, rest = [len(clip.X) for clip in clips], 4, tables().rest
    schedule = make_schedule(
        lengths, lanes=5, window=window, steps=6, seed=1, from_first=0.5, true_starts=1.0, lane_windows=2
    )
    batch_at = batches(clips, schedule, rest, window)
    for step, lanes in enumerate(schedule):
        batch = batch_at(step)
        for lane, (c, s) in enumerate(zip(lanes.clip, lanes.start, strict=True)):
            np.testing.assert_array_equal(batch.X_star[:, lane], clips[c].X[s : s + window])
            for found, leaf in zip(batch.frame, clips[c].frames, strict=True):
                np.testing.assert_array_equal(found[:, lane], leaf[s : s + window])
            np.testing.assert_array_equal(batch.X_start[lane], clips[c].X[s - 1] if s else rest)
        np.testing.assert_array_equal(batch.fresh, lanes.fresh)
        np.testing.assert_array_equal(batch.noisy, lanes.fresh & (lanes.start > 0))


def test_cells_are_the_weighted_means_of_their_vertices_in_mirror_images_too(data: DataSet) -> None:
    down, filled = tables().down, tables().filled > 0
    for clip, found in zip(data.train, column_clips(data.train, data, tables()), strict=True):
        V = clip.V[7][data.mirror] * np.array([-1, 1, 1]) if clip.mirrored else clip.V[7]
        cells = (V[down.index] * down.weight[..., None]).sum(axis=1).reshape(8, 3, 3)
        cells = np.einsum("aij,ahj->ahi", tables().frames, cells - found.frames.anchor[7][:, None])
        np.testing.assert_allclose(found.X[7][filled], cells[filled], atol=1e-5)
