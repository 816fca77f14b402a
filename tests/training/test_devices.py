"""Two processes learn what one learns, their checkpoints are one's too; what cannot be shared is refused."""

import os
import socket
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from shutil import rmtree

import jax
import numpy as np
import pytest

from garment_jax.config import Config, to_toml
from garment_jax.training import column_rnn_stage, detail_stage, generative_stage, launch, motion_stage
from garment_jax.training.checkpoint import Checkpointer
from garment_jax.training.devices import ONE, Devices
from garment_jax.training.launch import check_group
from garment_jax.training.log import read_log
from garment_jax.training.pipeline import BATCHES, train
from garment_jax.training.run import open_run
from tests.animation.tiny_model import CONFIG, SCENE, tiny_model
from tests.reference.scene import make_motion, write_clip
from tests.reference.tiny_column_rnn import COLUMNS

ROOT = Path(__file__).parents[2]
STAGES = ("generative", "column_rnn")  # a plain batch, and lanes that go on from step to step
STEPS = 3
BOUND = 1e-5  # of all parameters' norm; measured: 2e-7


def shortened(config: Config) -> Config:
    """The tiny configuration with `STEPS` steps of `STAGES`, a checkpoint after each of them."""
    return replace(
        config,
        generative=replace(config.generative, steps=STEPS),
        detail=replace(config.detail, steps=0),
        column_rnn=replace(COLUMNS, steps=STEPS, lanes=2),
    )


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two short dances to train on, and one that is kept back."""
    folder = tmp_path_factory.mktemp("data")
    for k, frames in enumerate((20, 17, 14), start=1):
        motion = make_motion(SCENE, frames, seed=k)
        write_clip(folder / "train" / f"waltz_{k}.h5", scene=SCENE, motion=motion)
    return folder


def group(count: int, config: Config, folder: Path, data_dir: Path, *words: str) -> list:
    """What became of `count` processes that train together in `folder / "run"`."""
    (folder / "tiny.toml").write_text(to_toml(config))
    with socket.create_server(("localhost", 0)) as free:
        port = free.getsockname()[1]
    call = [sys.executable, "train.py", str(folder / "tiny.toml"), "--data", str(data_dir)]
    call += [
        "--run-dir",
        str(folder / "run"),
        "--coordinator",
        f"localhost:{port}",
        "--processes",
        str(count),
    ]
    running = [
        subprocess.Popen(
            [*call, "--process", str(i), *words],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for i in range(count)
    ]
    try:
        said = [process.communicate(timeout=280) for process in running]
    finally:
        for process in running:
            process.kill()
    return [(process.returncode, *texts) for process, texts in zip(running, said, strict=True)]


def distance(stage: str, run: Path, other: Path, part: str = "params") -> float:
    """How far two runs' last states of a stage are apart, relative to their norm."""
    assert Checkpointer(run, stage).latest() == Checkpointer(other, stage).latest() == STEPS
    leaves = [jax.tree.leaves(Checkpointer(r, stage).tree(part)) for r in (run, other)]
    a, b = (np.concatenate([leaf.ravel().astype(np.float64) for leaf in each]) for each in leaves)
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


@pytest.mark.slow
def test_two_processes_learn_what_one_learns(tmp_path: Path, data_dir: Path) -> None:
    config = shortened(CONFIG)
    one, run = tmp_path / "one", tmp_path / "run"
    for stage in STAGES:
        train(config, one, data_dir=data_dir, stage=stage)
        first, second = group(2, config, tmp_path, data_dir, "--stage", stage)
        assert (first[0], second[0]) == (0, 0), first[2] + second[2]
        assert first[1].startswith(f"trained: {run}\n")
        assert second[1:] == ("", "")  # process 0 alone speaks
        assert distance(stage, run, one) < BOUND, stage
        logged = [[e["step"] for e in read_log(r, stage=stage)] for r in (run, one)]
        assert logged[0] == logged[1]
    assert distance("column_rnn", run, one, "carry") < BOUND

    # one goes on from the checkpoint of two, over which the carry was split
    rmtree(run / "checkpoints" / "column_rnn" / str(STEPS))
    train(config, run, data_dir=data_dir, stage="column_rnn")
    assert distance("column_rnn", run, one) < BOUND


def test_what_cannot_be_shared_ends_all_with_one_sentence(tmp_path: Path, data_dir: Path) -> None:
    config = shortened(CONFIG)
    results = group(2, config, tmp_path, data_dir, "--motion.lanes=3")
    assert [code for code, _, _ in results] == [2, 2]
    sentence = (
        "motion.lanes = 3 cannot be split over 2 devices; give --motion.lanes a multiple of 2, such as 4, or "
        "use fewer devices."
    )
    for _, _, said in results:
        assert said.splitlines()[-1].endswith(sentence)
        assert said.count("error: ") == 1
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (("", 2, 0), "--coordinator is missing; by hand give every process --coordinator HOST:PORT"),
        (("here:1", None, 0), "--processes is missing"),
        (("here:1", 2, None), "--process is missing"),
        (("here", 2, 0), "--coordinator here is no HOST:PORT; give it as in node1:12345."),
        (("here:port", 2, 0), "--coordinator here:port is no HOST:PORT"),
        (("here:70000", 2, 0), "--coordinator here:70000 is no HOST:PORT"),
        (("here:1", 0, 0), "--processes 0 is no number of processes; give 1 or more."),
        (("here:1", 2, 2), "--process 2 is none of 2; give 0 to 1."),
        (("here:1", 2, -1), "--process -1 is none of 2"),
    ],
)
def test_options_by_hand_that_do_not_go_together_are_refused(given: tuple, sentence: str) -> None:
    with pytest.raises(ValueError) as refusal:
        check_group(*given)
    assert sentence in str(refusal.value)


def test_a_launcher_whose_processes_jax_could_not_find_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launch, "find_spec", lambda package: None)
    assert launch._launcher({}) is None
    assert (
        launch._launcher({"OMPI_MCA_orte_hnp_uri": "1.0;tcp://here:1", "OMPI_COMM_WORLD_RANK": "1"}) is None
    )
    with pytest.raises(
        ValueError, match=r"this is process 1 of mpirun, and the package mpi4py, .* is missing;"
    ):
        launch._launcher({"OMPI_COMM_WORLD_RANK": "1"})
    with pytest.raises(
        ValueError, match=r"this is pod 3 of a Kubernetes Job, .* pip install kubernetes, or give"
    ):
        launch._launcher({"JOB_COMPLETION_INDEX": "3"})
    monkeypatch.setattr(launch, "find_spec", lambda package: package)
    assert launch._launcher({"PMI_RANK": "0"}) == "mpi4py"
    assert launch._launcher({"JOB_COMPLETION_INDEX": "3"}) is None  # JAX finds it by itself


def test_one_device_changes_nothing() -> None:
    check_group("", None, None)
    state, batch = {"carry": np.ones(3)}, np.ones(4)
    assert ONE.first
    assert ONE.spread(state) is ONE.whole(state) is ONE.local(state) is state
    assert ONE.put(batch, 0) is batch
    assert batch[ONE.rows(4)].base is batch
    assert ONE.of_first("x") == "x"
    ONE.check_batches({"motion.lanes": 7})


class Part(Devices):
    """One of `parts` processes, in so far as batches tell: it makes its rows."""

    index, parts = 0, 2

    def rows(self, size: int) -> slice:
        own = size // self.parts
        return slice(self.index * own, (self.index + 1) * own)


class Other(Part):
    index = 1


def test_the_rows_of_two_processes_are_the_batch_of_one(tmp_path: Path, data_dir: Path, monkeypatch) -> None:
    config = replace(shortened(CONFIG), motion=CONFIG.motion, detail=CONFIG.detail)
    run = open_run(config, tmp_path / "run", data_dir=data_dir)
    run.log.close()
    model = tiny_model().params
    made: dict[str, list] = {}

    def note(_run, stage: str, params: dict, _make_step, batch_at, *, axes=0, **_options) -> dict:
        made.setdefault(stage, []).append((batch_at(0), axes))  # all lanes begin
        return params

    for module in (generative_stage, motion_stage, detail_stage, column_rnn_stage):
        monkeypatch.setattr(module, "optimise", note)
    for devices in (ONE, Part(), Other()):
        part = run._replace(devices=devices)
        generative_stage.train_generative(part)
        motion_stage.train_motion(part, model["generative"])
        detail_stage.train_detail(part, model["generative"], model["motion"])
        column_rnn_stage.train_column_rnn(part)
    assert set(made) == set(BATCHES)
    for stage, ((whole, axes), (first, _), (second, _)) in made.items():

        def joined(axis: int, *parts):
            return jax.tree.map(lambda a, b: np.concatenate([a, b], axis), *parts)

        together = jax.tree.map(joined, axes if axes else type(whole)(*[0] * len(whole)), first, second)
        jax.tree.map(partial(np.testing.assert_allclose, atol=1e-6, err_msg=stage), together, whole)
