"""Stages taken over from another run: whole, with their log, under the new run's configuration."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from garment_jax.bench.files import read_json, write_json
from garment_jax.bench.identity import stage_name
from garment_jax.bench.sharing import share_prepared, share_stages
from garment_jax.config import Config, content_hash, to_dict
from garment_jax.training.checkpoint import Checkpointer
from garment_jax.training.log import RunLog, read_log
from tests.animation.tiny_model import CONFIG

WITHOUT = replace(CONFIG, motion=replace(CONFIG.motion, previous_state=False))
STEPS = {"generative": 8, "warm_up": 8, "motion": 8, "detail": CONFIG.detail.steps}


def write_run(folder: Path, config: Config, stages: tuple[str, ...]) -> Path:
    """Write what a trained run leaves: checkpoints, log, names of its stages, latents."""
    log = RunLog(folder)
    for k, stage in enumerate(stages):
        Checkpointer(folder, stage, metadata={"config": to_dict(config)}).save(
            STEPS[stage], {"params": np.full(3, float(k))}
        )
        log.write(stage, STEPS[stage], {"loss": 1.0}, seconds=5.0 + k)
    log.close()
    write_json(folder / "stages.json", {stage: stage_name(stage, config, "d") for stage in STEPS})
    (folder / "cache").mkdir()
    np.savez(folder / "cache" / "true_latents.npz", Z=np.zeros(2))
    np.save(folder / "cache" / "waltz.V.npy", np.zeros(4))
    (folder / "cache" / "waltz.V.npy.sha256").write_text("digest")
    np.save(folder / "cache" / "old.V.npy", np.zeros(4))  # unproven: made before there were digests
    return folder


def test_what_is_the_same_is_taken_over_and_the_rest_is_not(tmp_path: Path) -> None:
    other = write_run(tmp_path / "ours-a", CONFIG, ("generative", "warm_up", "motion", "detail"))
    run = tmp_path / "ours-b"
    share_prepared(run, tmp_path)
    assert share_stages(run, tmp_path, WITHOUT, "d") == ["generative", "detail"]
    saved = Checkpointer(run, "generative")
    assert saved.latest() == 8
    assert np.array_equal(saved.restore({"params": np.zeros(3)})["params"], np.zeros(3))
    assert saved.metadata()["metadata"]["config"] == to_dict(WITHOUT)
    assert saved.metadata()["metadata"]["config_hash"] == content_hash(WITHOUT)
    assert Checkpointer(other, "generative").metadata()["metadata"]["config"] == to_dict(CONFIG)
    assert [(e["stage"], e["seconds"]) for e in read_log(run)] == [("generative", 5.0), ("detail", 8.0)]
    assert (run / "cache" / "true_latents.npz").samefile(other / "cache" / "true_latents.npz")
    for name in ("waltz.V.npy", "waltz.V.npy.sha256"):
        assert (run / "cache" / name).samefile(other / "cache" / name)
    assert not (run / "cache" / "old.V.npy").exists()
    assert not (run / "checkpoints" / "warm_up").exists()


def test_other_data_or_an_unfinished_stage_gives_nothing(tmp_path: Path) -> None:
    other = write_run(tmp_path / "ours-a", CONFIG, ("generative",))
    assert share_stages(tmp_path / "ours-b", tmp_path, CONFIG, "other data") == []
    (other / "checkpoints" / "generative" / "8").rename(other / "checkpoints" / "generative" / "5")
    assert share_stages(tmp_path / "ours-c", tmp_path, CONFIG, "d") == []


def test_a_stage_that_was_begun_is_left_alone(tmp_path: Path) -> None:
    write_run(tmp_path / "ours-a", CONFIG, ("generative",))
    run = tmp_path / "ours-b"
    Checkpointer(run, "generative", metadata={}).save(3, {"params": np.ones(3)})
    assert share_stages(run, tmp_path, CONFIG, "d") == []
    assert Checkpointer(run, "generative").steps() == [3]


def test_taking_over_twice_changes_nothing(tmp_path: Path) -> None:
    write_run(tmp_path / "ours-a", CONFIG, ("generative", "warm_up"))
    run = tmp_path / "ours-b"
    assert share_stages(run, tmp_path, CONFIG, "d") == ["generative", "warm_up"]
    log = read_log(run)
    assert share_stages(run, tmp_path, CONFIG, "d") == []
    assert read_log(run) == log
    assert read_json(run / "stages.json") == read_json(tmp_path / "ours-a" / "stages.json")
