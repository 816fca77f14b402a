"""All stages by one command; killed in every one of them, the same command ends bit for bit alike."""

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax
import numpy as np
import pytest

from garment_jax.animation.animate import animate_file
from garment_jax.config import to_toml
from garment_jax.io.sequence import open_sequence
from garment_jax.model.store import load_model, save_model
from garment_jax.storage.processes import this_process
from garment_jax.storage.scratch import make_scratch
from garment_jax.training import column_rnn_stage
from garment_jax.training.checkpoint import Checkpointer
from garment_jax.training.log import read_log
from garment_jax.training.pipeline import train, trained_model
from tests.animation.tiny_model import CONFIG, SCENE, tiny_model
from tests.reference.scene import make_motion, write_clip
from tests.reference.tiny_column_rnn import COLUMNS, column_rnn_model

ROOT = Path(__file__).parents[2]
STAGES = ("generative", "warm_up", "motion", "detail")
STEPS = 8  # of every stage


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three short dances to train on, one of them kept back, and one to test with."""
    folder = tmp_path_factory.mktemp("data")
    for k, frames in enumerate((20, 17, 14), start=1):
        motion = make_motion(SCENE, frames, seed=k)
        write_clip(folder / "train" / f"waltz_{k}.h5", scene=SCENE, motion=motion)
    write_clip(folder / "test" / "polka.h5", scene=SCENE, motion=make_motion(SCENE, 15, seed=8))
    return folder


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory, data_dir: Path) -> Path:
    """A run that nothing disturbs."""
    return train(CONFIG, tmp_path_factory.mktemp("whole") / "run", data_dir=data_dir)


def state_of(run: Path, stage: str) -> dict:
    """Everything that the stage's last checkpoint holds."""
    saved = Checkpointer(run, stage)
    assert saved.latest() == STEPS, stage
    return {part: saved.tree(part) for part in ("params", "opt_state", "key", "step", "carry")}


def assert_same_bits(a: dict, b: dict) -> None:
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert x.tobytes() == y.tobytes()


def command(config: Path, data_dir: Path, run: Path) -> list[str]:
    words = [sys.executable, "train.py", str(config), "--data", str(data_dir), "--run-dir", str(run)]
    # passed on the command line, as a user would
    return [*words, "--training.log_every", "1", "--training.checkpoint_seconds=0"]


def environment() -> dict[str, str]:
    """Compiled programs are shared: what the uninterrupted run compiled is not compiled again."""
    return {**os.environ, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0", "PYTHONPATH": str(ROOT)}


def kill_within(stage: str, words: list[str], run: Path, wait: float) -> subprocess.CompletedProcess:
    """Start the command and kill it with signal 9, `wait` seconds after the stage's first checkpoint."""
    with tempfile.TemporaryFile("w+") as said:  # a pipe that nobody reads fills up
        process = subprocess.Popen(words, cwd=ROOT, env=environment(), stderr=said)
        try:
            saved, deadline = Checkpointer(run, stage), time.monotonic() + 300
            while saved.latest() is None and process.poll() is None and time.monotonic() < deadline:
                time.sleep(0.002)
            time.sleep(wait)
        finally:
            process.kill()
            process.wait()
        said.seek(0)
        return subprocess.CompletedProcess(words, process.returncode, stderr=said.read())


def test_kill_9_in_every_stage_then_the_same_command(tmp_path: Path, data_dir: Path, uninterrupted: Path):
    config, run = tmp_path / "tiny.toml", tmp_path / "run"
    config.write_text(to_toml(CONFIG))
    words, rng = command(config, data_dir, run), random.Random(os.urandom(8))
    for stage in STAGES:
        killed = kill_within(stage, words, run, rng.uniform(0.0, 0.1))
        assert killed.returncode == -signal.SIGKILL, killed.stderr
        done = Checkpointer(run, stage).latest()
        assert done is not None
        assert done <= STEPS
    whole = subprocess.run(words, cwd=ROOT, env=environment(), capture_output=True, text=True, check=False)
    assert whole.returncode == 0, whole.stderr
    assert whole.stdout.startswith(f"trained: {run}\n")
    assert "generative: 8 of 8 steps are done; complete, nothing to do" in whole.stderr
    for stage in STAGES:
        assert_same_bits(state_of(run, stage), state_of(uninterrupted, stage))
        logged = [[e["step"] for e in read_log(r, stage=stage, kind="train")] for r in (run, uninterrupted)]
        assert logged[0] == logged[1] == list(range(1, STEPS + 1))


def test_the_column_rnn_joins_a_finished_run_and_survives_kill_9(
    tmp_path: Path, data_dir: Path, uninterrupted: Path
):
    from shutil import copytree

    (tmp_path / "tiny.toml").write_text(to_toml(replace(CONFIG, column_rnn=COLUMNS)))
    runs = [copytree(uninterrupted, tmp_path / name) for name in ("killed", "whole")]
    lines = [[*command(tmp_path / "tiny.toml", data_dir, run), "--stage", "column_rnn"] for run in runs]
    assert kill_within("column_rnn", lines[0], runs[0], 0.05).returncode == -signal.SIGKILL
    for words in lines:
        subprocess.run(words, cwd=ROOT, env=environment(), capture_output=True, check=True)
    killed, whole = (state_of(run, "column_rnn") for run in runs)
    assert_same_bits(killed, whole)
    assert_same_bits(state_of(runs[0], "detail"), state_of(uninterrupted, "detail"))
    assert set(trained_model(runs[1]).params) == {"generative", "motion", "detail", "column_rnn"}
    older = runs[1] / "checkpoints" / "column_rnn"
    older.rename(older.with_name("swing"))  # as runs had it before the stage's name
    assert_same_bits(state_of(runs[1], "column_rnn"), whole)
    assert set(trained_model(runs[1]).params) == {"generative", "motion", "detail", "column_rnn"}
    (last,) = read_log(runs[1], stage="column_rnn", kind="validation")
    assert 0 < last["waltz_3_rmse_cm"] < 100


def test_single_stages_make_no_targets_that_they_do_not_read(
    tmp_path: Path, data_dir: Path, uninterrupted: Path
):
    config = replace(CONFIG, column_rnn=COLUMNS)
    run = train(config, tmp_path / "run", data_dir=data_dir, stage="generative")
    targets = sorted((run / "cache").glob("*T_tilde.npy"))
    assert len(targets) == 3
    for path in targets:
        path.unlink()
    for stage in ("motion", "detail", "column_rnn"):
        train(config, run, data_dir=data_dir, stage=stage)
    assert not list((run / "cache").glob("*T_tilde.npy"))
    for stage in STAGES:
        assert_same_bits(state_of(run, stage), state_of(uninterrupted, stage))


def test_the_column_rnn_alone_is_trained_beside_a_saved_model(
    tmp_path: Path,
    data_dir: Path,
    uninterrupted: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    whole = trained_model(uninterrupted)
    latents = save_model(whole, tmp_path / "latents", bits=32)
    beside = replace(CONFIG, column_rnn=COLUMNS, training=replace(CONFIG.training, begin_from=str(latents)))
    run = train(beside, tmp_path / "run", data_dir=data_dir, stage="column_rnn")
    model = trained_model(run)
    for part in ("generative", "motion", "detail"):
        jax.tree.map(np.testing.assert_array_equal, model.params[part], whole.params[part])
    assert set(model.params) == {"generative", "motion", "detail", "column_rnn"}
    figures = animate_file(model, data_dir / "test" / "polka.h5", tmp_path / "polka.h5")
    assert figures["frames"] == 15
    save_model(column_rnn_model()._replace(statistics=whole.statistics), latents, bits=32)
    with pytest.raises(ValueError, match="and that is no longer there; put it back"):
        trained_model(run)
    begun = []

    def before_the_first_step(run, stage, params, *_, **__):
        begun.append(params)
        return params

    monkeypatch.setattr(column_rnn_stage, "optimise", before_the_first_step)
    train(beside, tmp_path / "on", data_dir=data_dir, stage="column_rnn")
    jax.tree.map(np.testing.assert_array_equal, begun[0], column_rnn_model().params["column_rnn"])
    wide = replace(beside, column_rnn=replace(COLUMNS, hidden=7))
    train(wide, tmp_path / "wide", data_dir=data_dir, stage="column_rnn")
    said = f"begins afresh, for that of {latents} has hidden 6, not 7; to go on from it take the [column_rnn]"
    assert said in capsys.readouterr().err
    train(wide, tmp_path / "wide", data_dir=data_dir, stage="column_rnn")
    assert said not in capsys.readouterr().err  # once: now the run is there
    assert begun[-1]["gates_h"]["kernel"].shape == (7, 21)
    long = replace(CONFIG, column_rnn=replace(COLUMNS, window=999))
    with pytest.raises(
        ValueError, match=r"column_rnn\.window = 999 frames, but the longest training clip has"
    ):
        train(long, tmp_path / "long", data_dir=data_dir)


def test_all_stages_begin_from_a_saved_model(tmp_path: Path, data_dir: Path, uninterrupted: Path):
    """At next to no rate what comes out is what went in, by the same statistics."""
    whole = trained_model(uninterrupted)
    folder = save_model(whole, tmp_path / "model", bits=32)
    still = {"learning_rate": 1e-12, "weight_decay": 0.0}
    config = replace(
        CONFIG,
        generative=replace(CONFIG.generative, **still),
        motion=replace(CONFIG.motion, warm_up_rate=1e-12, **still),
        detail=replace(CONFIG.detail, **still),
        training=replace(CONFIG.training, begin_from=str(folder)),
    )
    fewer = tmp_path / "fewer"  # clips that alone have other statistics
    (fewer / "train").mkdir(parents=True)
    for path in sorted((data_dir / "train").glob("*.h5"))[1:]:
        (fewer / "train" / path.name).symlink_to(path)
    again = trained_model(train(config, tmp_path / "run", data_dir=fewer))
    jax.tree.map(partial(np.testing.assert_allclose, atol=1e-9), again.params, whole.params)
    for known, found in zip(whole.statistics, again.statistics, strict=True):
        np.testing.assert_allclose(found, known, rtol=1e-6)
    lean = whole._replace(params={k: v for k, v in whole.params.items() if k != "detail"})
    refused = {
        "motion.gru = 16, not 12": (folder, replace(config, motion=replace(config.motion, gru=12))),
        "data.mirror = True, not False": (
            folder,
            replace(
                config,
                data=replace(config.data, mirror=False),
                generative=replace(config.generative, skin_reach=0.1),
            ),
        ),
        "template, faces or UVs have the hash": (
            save_model(whole._replace(garment_hash="0123"), tmp_path / "other"),
            config,
        ),
        "fps = 60.0, not 30.0": (save_model(whole._replace(fps=60.0), tmp_path / "fast"), config),
        "has no detail stage; begin afresh, or set": (save_model(lean, tmp_path / "lean"), config),
    }
    for k, (match, (model, asked)) in enumerate(refused.items()):
        asked = replace(asked, training=replace(asked.training, begin_from=str(model)))
        with pytest.raises(ValueError, match=match):
            train(asked, tmp_path / f"refused_{k}", data_dir=fewer)
        assert not (tmp_path / f"refused_{k}").exists()
    save_model(whole._replace(statistics=tiny_model().statistics), folder)
    with pytest.raises(ValueError, match="belongs to another run"):
        train(config, tmp_path / "run", data_dir=fewer)


def test_stages_of_no_steps_are_those_of_the_model_begun_from(
    tmp_path: Path, data_dir: Path, uninterrupted: Path
):
    whole = trained_model(uninterrupted)
    begin_from = str(save_model(whole, tmp_path / "model", bits=32))
    config = replace(CONFIG, training=replace(CONFIG.training, begin_from=begin_from))
    idle = {
        "generative": replace(config, generative=replace(config.generative, steps=0)),
        "motion": replace(config, motion=replace(config.motion, steps=0, warm_up_steps=0)),
    }
    for name, asked in idle.items():
        model = trained_model(train(asked, tmp_path / name, data_dir=data_dir))
        for part in ("generative", "motion"):
            pairs = zip(jax.tree.leaves(model.params[part]), jax.tree.leaves(whole.params[part]), strict=True)
            assert all(np.array_equal(a, b) for a, b in pairs) is (part == name), (name, part)
    for name, asked in idle.items():
        alone = replace(asked, training=CONFIG.training)
        with pytest.raises(ValueError, match=rf"{name}\.steps = 0 leaves the {name} stage untrained"):
            train(alone, tmp_path / "refused", data_dir=data_dir)
    assert not (tmp_path / "refused").exists()


def test_a_warm_up_alone_is_a_motion_encoder(tmp_path: Path, data_dir: Path):
    config = replace(CONFIG, motion=replace(CONFIG.motion, steps=0), detail=replace(CONFIG.detail, steps=0))
    run = train(config, tmp_path / "run", data_dir=data_dir)
    warm = Checkpointer(run, "warm_up").tree("params")
    jax.tree.map(np.testing.assert_array_equal, trained_model(run).params["motion"], warm)


def test_a_column_rnn_of_no_steps_is_refused(tmp_path: Path, data_dir: Path):
    with pytest.raises(ValueError, match=r"column_rnn\.steps = 0 leaves the column RNN out"):
        train(CONFIG, tmp_path / "run", data_dir=data_dir, stage="column_rnn")


def test_every_stage_learns_something_and_validates(uninterrupted: Path):
    for stage in STAGES:
        losses = [entry["loss"] for entry in read_log(uninterrupted, stage=stage, kind="train")]
        assert np.isfinite(losses).all()
        state = state_of(uninterrupted, stage)
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(state["params"]))
    for stage in STAGES[:3]:
        (last,) = read_log(uninterrupted, stage=stage, kind="validation")
        assert last["step"] == STEPS
        assert 0 < last["rmse_cm"] < 100
        assert last["waltz_3_rmse_cm"] == last["rmse_cm"]


def test_a_finished_run_is_left_alone_and_single_stages_join_it(
    uninterrupted: Path, data_dir: Path, capsys: pytest.CaptureFixture
):
    before = (uninterrupted / "log.jsonl").read_bytes()
    assert train(CONFIG, uninterrupted, data_dir=data_dir, stage="generative") == uninterrupted
    assert "complete, nothing to do" in capsys.readouterr().err
    assert (uninterrupted / "log.jsonl").read_bytes() == before


def test_what_a_killed_training_left_beside_a_finished_stage_goes(
    tmp_path: Path, data_dir: Path, uninterrupted: Path
):
    from shutil import copytree

    run = copytree(uninterrupted, tmp_path / "run")
    with subprocess.Popen(["true"]) as ended:
        pid, started, host = ended.pid, *this_process()[1:]
    name = f".{pid}-{started}-{host}-{'0' * 16}.partial"
    left = [place / name for place in (run, run / "cache", run / "checkpoints" / "warm_up")]
    for folder in left:
        folder.mkdir()
    train(CONFIG, run, data_dir=data_dir)
    assert not any(folder.exists() for folder in left)


@pytest.mark.parametrize("config", [None, 7, "gone"])
def test_a_checkpoint_that_says_no_configuration_is_a_sentence(
    tmp_path: Path, uninterrupted: Path, config: object
):
    from shutil import copytree

    run = copytree(uninterrupted, tmp_path / "run")
    (newest,) = sorted((run / "checkpoints" / "motion").iterdir())[-1:]
    (newest / "digests.json").unlink()  # as older versions wrote it
    described = json.loads((newest / "metadata.json").read_text())
    described["metadata"]["config"] = config
    if config == "gone":
        del described["metadata"]["config"]
    (newest / "metadata.json").write_text(json.dumps(described))
    with pytest.raises(ValueError, match=r"motion is damaged: its newest .* has no configuration"):
        trained_model(run)


def test_the_run_is_a_model_and_16_bits_of_it_animate_alike(
    tmp_path: Path, data_dir: Path, uninterrupted: Path
):
    model = trained_model(uninterrupted)
    assert set(model.params) == {"generative", "motion", "detail"}
    assert (model.config, model.vertices, model.fps) == (CONFIG, len(SCENE.garment.template), 30.0)
    small = trained_model(save_model(model, tmp_path / "model"))
    assert load_model(tmp_path / "model").garment_hash == small.garment_hash == model.garment_hash
    clip, made = data_dir / "test" / "polka.h5", []
    for name, which in (("full", model), ("half", small)):
        animate_file(which, clip, tmp_path / f"{name}.h5", collision=False)
        with open_sequence(tmp_path / f"{name}.h5") as sequence:
            made.append(sequence.read(0, 15))
    assert 0 < np.sqrt(np.square(made[1] - made[0]).sum(axis=-1).mean()) < 0.01


def test_how_a_run_is_used_may_change_afterwards(tmp_path: Path, data_dir: Path, uninterrupted: Path):
    from shutil import copytree

    copytree(uninterrupted, tmp_path / "run")
    collision = replace(CONFIG.collision, eps=0.002, limbs=not CONFIG.collision.limbs)
    changed = replace(CONFIG, collision=collision)
    train(changed, tmp_path / "run", data_dir=data_dir)
    assert trained_model(tmp_path / "run").config == changed


def test_clips_shorter_than_a_window_are_refused_before_anything_is_trained(tmp_path: Path, data_dir: Path):
    wide = replace(CONFIG, motion=replace(CONFIG.motion, window=21))
    with pytest.raises(ValueError, match=r"motion\.window = 21 frames, but the longest training clip has 20"):
        train(wide, tmp_path / "run", data_dir=data_dir)
    assert not (tmp_path / "run" / "config.toml").exists()  # or the remedy would be another run's
    assert not (tmp_path / "run" / "checkpoints").exists()


def test_a_run_that_goes_on_animates_with_what_it_has(tmp_path: Path, data_dir: Path, uninterrupted: Path):
    """Before the detail stage, and before the motion stage's first checkpoint, there is a model already."""
    from shutil import copytree

    early = tmp_path / "early"
    copytree(uninterrupted / "checkpoints" / "generative", early / "checkpoints" / "generative")
    with pytest.raises(
        ValueError, match=r"has not trained its motion stage yet; run train\.py --stage motion"
    ):
        trained_model(early)
    copytree(uninterrupted / "checkpoints" / "warm_up", early / "checkpoints" / "warm_up")
    half = make_scratch(early / "checkpoints" / "warm_up")
    model = trained_model(early)
    assert set(model.params) == {"generative", "motion"}
    assert_same_bits(
        jax.tree.map(np.asarray, model.params["motion"]),
        Checkpointer(uninterrupted, "warm_up").tree("params"),
    )
    assert half.is_dir()  # what is being written stays
    with pytest.raises(FileNotFoundError, match=r"holds no config\.toml; name a run of train\.py"):
        trained_model(tmp_path / "nowhere")


@pytest.mark.parametrize(("stage", "missing"), [("motion", "generative"), ("detail", "generative")])
def test_a_stage_without_its_predecessor_is_refused(tmp_path: Path, data_dir: Path, stage: str, missing: str):
    sentence = f"holds no finished {missing} stage; train it first with --stage {missing}"
    with pytest.raises(ValueError, match=sentence):
        train(CONFIG, tmp_path / "run", data_dir=data_dir, stage=stage)
    assert not (tmp_path / "run").exists()


def test_an_unknown_stage_is_refused(tmp_path: Path, data_dir: Path):
    with pytest.raises(
        ValueError, match="--stage 'sewing' is unknown; choose all, generative, motion, detail"
    ):
        train(CONFIG, tmp_path / "run", data_dir=data_dir, stage="sewing")


def test_all_stages_train_in_canonical_pose(tmp_path: Path, data_dir: Path):
    config = replace(
        CONFIG,
        generative=replace(CONFIG.generative, skin_reach=0.1),
        detail=replace(CONFIG.detail, source="rollout"),
    )
    model = trained_model(train(config, tmp_path / "run", data_dir=data_dir))
    assert set(model.params) == {"generative", "motion", "detail"}
    figures = animate_file(model, data_dir / "test" / "polka.h5", tmp_path / "polka.h5")
    assert figures["frames"] == 15
    with open_sequence(tmp_path / "polka.h5") as made, open_sequence(data_dir / "test" / "polka.h5") as true:
        assert np.abs(made.read(0, 15) - true.read(0, 15)).max() < 0.5  # metres: on the body, if not trained
