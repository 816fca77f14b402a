"""Power by sixths of a clip whose ripples grow half-way."""

from pathlib import Path

import numpy as np

from garment_jax.io.sequence import SequenceWriter
from tests.benchmarks.scripts import script
from tests.reference.scene import make_motion, make_scene

states = script("fold_states")


def test_sixths_are_means_in_order():
    assert states.parts(np.arange(12.0)) == [0.5, 2.5, 4.5, 6.5, 8.5, 10.5]


def test_a_clip_that_begins_flat_and_ends_rippled_deepens(tmp_path: Path):
    scene = make_scene(8, 16)
    motion = make_motion(scene, 24, seed=1)
    ripple = np.random.default_rng(0).normal(0, 0.004, scene.garment.template.shape)
    height = np.where(np.arange(24) < 12, 1.0, 3.0)[:, None, None]
    V = scene.garment.template + motion.root[:, None] + height * ripple
    still = scene.garment.template + motion.root[:, None] + 1.1 * ripple[None]
    truth, rollout = tmp_path / "truth.h5", tmp_path / "made.h5"
    for path, frames in ((truth, V), (rollout, still)):
        with SequenceWriter(path, scene, motion, encoding="float32") as writer:
            writer.append(frames.astype(np.float32))
    row = states.clip_row(truth, rollout, 1)
    # the same ripples three times as high, on the power of a rest shape; the error twenty times as large
    assert 2 < row["deepens"] < 9
    assert 15 < row["error grows"] < 25
    alone = states.clip_row(truth, None, 1)
    assert alone["truth mm2"] == row["truth mm2"]
    assert alone["error grows"] == ""
