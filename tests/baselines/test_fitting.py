"""What a baseline is fitted to: the same clips as ours, recorded or simulated."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from garment_jax.baselines.fitting import open_baseline
from garment_jax.config import SimulationConfig
from garment_jax.training.run import open_run
from tests.animation.tiny_model import CONFIG, SCENE
from tests.reference.scene import make_motion, write_clip

CLOTH = ("substeps=3", "iterations=3", "linear_iterations=8", "settle=2", "blend=2", "hold=1")
CONFIG = replace(
    CONFIG,
    data=replace(CONFIG.data, validation=()),
    simulation=SimulationConfig(clips=2, longest=6, cloth=CLOTH),
)


def test_simulated_clips_are_those_that_ours_learn_from(tmp_path: Path) -> None:
    pytest.importorskip("newton")
    write_clip(tmp_path / "train" / "waltz.h5", scene=SCENE, motion=make_motion(SCENE, 30))
    ours = open_run(CONFIG, tmp_path / "ours", data_dir=tmp_path, unposed=False)
    ours.log.close()
    with open_baseline("ridge", ("ridge",), CONFIG, tmp_path / "ridge", tmp_path) as run:
        assert len(run.data.train) > 2  # the waltz and its mirror image
        for a, b in zip(run.data.train, ours.data.train, strict=True):
            np.testing.assert_array_equal(a.V, b.V)
            np.testing.assert_array_equal(a.input.x.M, b.input.x.M)
    wrong = replace(CONFIG, simulation=replace(CONFIG.simulation, cloth=("bendy=1",)))
    with (
        pytest.raises(ValueError, match=r"simulation\.cloth 'bendy=1': there is no setting"),
        open_baseline("ridge", ("ridge",), wrong, tmp_path / "wrong", tmp_path),
    ):
        pass
