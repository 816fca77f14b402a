"""Seconds of a step out of a log, and the configuration that such a log is of."""

from dataclasses import replace
from pathlib import Path

import pytest

from garment_jax.dataset.prepared import prepare
from garment_jax.learning.calibration import STEPS, calibrate, step_seconds, with_steps
from garment_jax.learning.networks import config_for
from tests.animation.tiny_model import CONFIG, SCENE
from tests.reference.scene import make_motion, make_scene, write_clip


def test_compiling_and_the_first_steps_do_not_count() -> None:
    log = [{"stage": "motion", "seconds": s} for s in (30.0, 30.1, 31.0, 33.0, 35.0)]
    log += [{"stage": "detail", "seconds": s} for s in (5.0, 5.1, 5.3, 5.4, 9.0)]
    assert step_seconds(log) == {"motion": pytest.approx(2.0), "detail": pytest.approx(1.85)}


def test_only_stages_that_are_trained_are_measured() -> None:
    config = config_for(make_scene(), {"generative": 1, "column_rnn": 0}, seconds=10.0, seed=0)
    few = with_steps(config, STEPS)
    assert (few.generative.steps, few.motion.warm_up_steps) == (STEPS["generative"], STEPS["warm_up"])
    assert few.column_rnn.steps == 0
    assert few.training.log_every == 1


def test_what_is_prepared_serves_the_training(tmp_path: Path) -> None:
    for seed in range(2):
        motion = make_motion(SCENE, 30, seed)
        write_clip(tmp_path / "clips" / "train" / f"{seed}.h5", seed=seed, scene=SCENE, motion=motion)
    config = replace(CONFIG, data=replace(CONFIG.data, validation=()))
    found = calibrate(config, tmp_path / "clips", tmp_path / "run")
    assert set(found.seconds_per_step) == {"generative", "warm_up", "motion", "detail"}
    made = {file.name: file.stat().st_mtime_ns for file in (tmp_path / "run" / "cache").iterdir()}
    assert {name.split(".", 1)[1] for name in made} >= {"V.npy", "V.npy.sha256", "T_tilde.npy"}
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []
    data = prepare(tmp_path / "clips", config, tmp_path / "run" / "cache")
    assert len(data.train) == 4
    for file in (tmp_path / "run" / "cache").glob("*.npy"):
        assert file.stat().st_mtime_ns == made[file.name]
