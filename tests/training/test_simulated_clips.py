"""Clips simulated to train on: a function of configuration and seed, in files of the run."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from garment_jax.config import ColumnRnnConfig, Config, SimulationConfig
from garment_jax.dataset.prepared import DataSet, prepare
from garment_jax.dataset.template import ColumnTables
from garment_jax.io.sequence import open_sequence
from garment_jax.model.column_rnn.train_step import ColumnBatch
from garment_jax.simulation import clips, many
from garment_jax.structs import TrainState
from garment_jax.training import column_rnn_stage, pipeline, simulated_clips
from garment_jax.training.checkpoint import Checkpointer
from garment_jax.training.run import open_run
from garment_jax.training.simulated_clips import check_motions, make_simulated_clips
from tests.animation.tiny_model import CONFIG, SCENE
from tests.reference.scene import make_motion, write_clip
from tests.reference.tiny_column_rnn import COLUMNS

pytest.importorskip("newton")

CLOTH = ("substeps=3", "iterations=3", "linear_iterations=8", "settle=2", "blend=2", "hold=1")
SIMULATION = SimulationConfig(clips=3, longest=7, cloth=CLOTH)
ALONE = replace(CONFIG, data=replace(CONFIG.data, validation=()), simulation=SIMULATION)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clips")
    for seed in range(3):
        motion = make_motion(SCENE, 30, seed)
        write_clip(folder / "train" / f"{seed}.h5", seed=seed, scene=SCENE, motion=motion, encoding="float32")
    return folder


@pytest.fixture(scope="module")
def data(folder: Path) -> DataSet:
    (folder / "cache").mkdir()
    return prepare(folder, ALONE, folder / "cache", unposed=False)


def simulated(data: DataSet, folder: Path, config: Config = ALONE) -> list[np.ndarray]:
    files = make_simulated_clips(data, config, folder, say=lambda _: None)
    return [open_sequence(file).read(0, 7) for file in files]


@pytest.fixture(scope="module")
def made(data: DataSet, tmp_path_factory: pytest.TempPathFactory) -> list[np.ndarray]:
    """Simulated clips; one of the three motions may not be fit to be learnt from."""
    return simulated(data, tmp_path_factory.mktemp("made"))


def test_clips_hang_on_configuration_and_seed_alone(data: DataSet, made, tmp_path: Path):
    assert len(made) in (2, 3)
    for a, b in zip(made, simulated(data, tmp_path), strict=True):
        np.testing.assert_array_equal(a, b)


def test_what_is_there_is_kept_and_what_is_missing_is_made_again(
    data: DataSet, made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated(data, tmp_path)
    kept = sorted((tmp_path / "clips" / "train").iterdir())
    known = json.loads((tmp_path / "clips" / "drawn.json").read_text())
    assert [file.stem for file in kept] == known["kept"]
    assert sorted([*known["kept"], *known["left_out"]]) == ["drawn_0001", "drawn_0002", "drawn_0003"]
    begun = []
    simulate = clips.simulate_many
    monkeypatch.setattr(clips, "simulate_many", lambda *a, **k: begun.append(a[1]) or simulate(*a, **k))
    simulated(data, tmp_path)
    assert not begun
    before = kept[1].stat().st_mtime_ns
    kept[0].unlink()
    for a, b in zip(made, simulated(data, tmp_path), strict=True):
        np.testing.assert_array_equal(a, b)
    assert len(begun) == 1
    assert kept[1].stat().st_mtime_ns == before


def test_they_are_prepared_beside_the_recorded_ones(folder: Path, data: DataSet, made, tmp_path: Path):
    files = make_simulated_clips(data, ALONE, tmp_path, say=lambda _: None)
    both = prepare(folder, ALONE, tmp_path / "cache", more=files, unposed=False)
    assert [clip.name for clip in both.train[: len(data.train)]] == [clip.name for clip in data.train]
    new = both.train[len(data.train) :]
    assert [clip.mirrored for clip in new] == [False, True] * len(made)
    assert both.content != data.content


def test_clips_side_by_side_are_those_one_by_one(
    data: DataSet, made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from garment_jax.simulation.side_by_side import SideBySide

    held = []

    def on_this_cpu(scene, settings, flat, clips, device):
        held.append((clips, device))
        return SideBySide(scene, settings, flat, clips, "cpu")

    monkeypatch.setattr(many, "_side_by_side", on_this_cpu)
    on_gpu = replace(ALONE, simulation=replace(SIMULATION, device="cuda", at_once=2))
    together = simulated(data, tmp_path, on_gpu)
    assert held == [(2, "cuda")]
    for a, b in zip(together, made, strict=True):
        np.testing.assert_allclose(a, b, atol=2e-3)


def test_runs_of_other_seeds_and_networks_share_a_folder(
    folder: Path, data: DataSet, made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared = replace(ALONE, simulation=replace(SIMULATION, dir=str(tmp_path / "shared")))
    simulated(data, tmp_path / "a", shared)
    monkeypatch.setattr(simulated_clips, "drawn_motions", None)
    other = replace(
        shared,
        data=replace(shared.data, mirror=False),
        training=replace(shared.training, seed=3),
        generative=replace(shared.generative, skin_reach=0.0),
    )
    (tmp_path / "b").mkdir()
    for a, b in zip(
        made, simulated(prepare(folder, other, tmp_path / "b"), tmp_path / "b", other), strict=True
    ):
        np.testing.assert_array_equal(a, b)
    assert not (tmp_path / "b" / "clips").exists()
    for changes, what in (
        ({"seed": 1}, r"with another simulation\.seed"),
        ({"longest": 6}, r"simulation\.longest"),
    ):
        with pytest.raises(ValueError, match=f"shared holds clips that were drawn .*{what}; name another"):
            simulated(data, tmp_path, replace(shared, simulation=replace(shared.simulation, **changes)))
    fewer = data._replace(train=data.train[2:])
    with pytest.raises(ValueError, match="drawn out of other clips; name another"):
        simulated(fewer, tmp_path, shared)


def test_clips_for_which_there_is_no_room_are_not_begun(
    data: DataSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = shutil.disk_usage(tmp_path)._replace(free=20_000)
    monkeypatch.setattr(simulated_clips.shutil, "disk_usage", lambda place: full)
    n = len(SCENE.garment.template)
    needed = f"{24 * 3 * 7 * n / 1e9:.3g} GB"
    with pytest.raises(
        OSError, match=f"prepared frames take up to {needed} in .*; make room, or give simulation"
    ):
        simulated(data, tmp_path)
    assert not (tmp_path / "clips").exists()


def test_no_clip_that_can_be_learnt_from_is_refused(
    data: DataSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clips, "faults", lambda screen, limits: ["strain"])
    with pytest.raises(ValueError, match="none of 3 simulated clips can be learnt from"):
        simulated(data, tmp_path)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"cloth": ("bendy=1",)}, r"simulation\.cloth 'bendy=1': there is no setting 'bendy'"),
        ({"pattern": "nowhere.npz"}, r"nowhere\.npz is not there; name the file of the flat pattern"),
        (
            {"kinds": ("danced turn=3",)},
            r"simulation\.kinds .danced turn=3. must begin with varied or",
        ),
        ({"device": "cuda:9"}, "the device cuda:9 is not there"),
        ({"dir": __file__}, r"simulation\.dir .*\.py is a file; name a folder"),
    ],
)
def test_what_cannot_be_simulated_is_refused_before_any_clip_is_read(
    folder: Path, tmp_path: Path, changes: dict, sentence: str
) -> None:
    config = replace(ALONE, simulation=replace(SIMULATION, **changes))
    with pytest.raises((ValueError, OSError), match=sentence):
        open_run(config, tmp_path / "run", data_dir=folder)
    assert not (tmp_path / "run").exists()


def test_motions_that_are_too_few_to_cross_are_refused(data: DataSet) -> None:
    few = data._replace(train=data.train[:4])  # two and their mirror images
    with pytest.raises(ValueError, match="all crossed of 3 motions, and 2 are there; add a kind"):
        check_motions(replace(SIMULATION, kinds=("crossed turn=3",)), few)


def test_a_run_that_learnt_from_other_simulated_clips_is_refused(folder: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    open_run(ALONE, run, data_dir=folder, unposed=False).log.close()
    open_run(ALONE, run, data_dir=folder, unposed=False).log.close()
    assert "simulated" in json.loads((run / "facts.json").read_text())
    (run / "checkpoints" / "motion" / "5").mkdir(parents=True)
    known = json.loads((run / "clips" / "drawn.json").read_text())
    known["left_out"][known["kept"].pop()] = ["strain"]
    (run / "clips" / "drawn.json").write_text(json.dumps(known))
    with pytest.raises(ValueError, match=r"learnt from other simulated clips than .*another --run-dir"):
        open_run(ALONE, run, data_dir=folder, unposed=False)


def cheap_step(tables: ColumnTables, config: ColumnRnnConfig, optimiser: optax.GradientTransformation):
    """A step that compiles in no time and hangs on batch, key and parameters."""

    @jax.jit
    def step(state: TrainState, batch: ColumnBatch):
        key, used = jax.random.split(state.key)
        move = batch.X_star.mean() + 0.1 * jax.random.normal(used)
        params = jax.tree.map(lambda leaf: 0.9 * leaf + move, state.params)
        return TrainState(params, state.opt_state, key, state.step + 1, state.carry), {"loss": jnp.abs(move)}

    return step


def test_a_column_rnn_learns_from_them_and_goes_on_to_the_same_bits(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(column_rnn_stage, "make_column_train_step", cheap_step)
    training = replace(CONFIG.training, average=0.5, log_every=3)
    config = replace(ALONE, column_rnn=COLUMNS, training=training)
    saved = Checkpointer(tmp_path / "run", "column_rnn")

    def run(config: Config = config) -> dict:
        pipeline.train(config, tmp_path / "run", data_dir=folder, stage="column_rnn")
        return saved.tree("params")

    whole = run()
    assert saved.steps() == [6, 8]
    shutil.rmtree(saved.folder / "8")  # as if it had been killed before
    jax.tree.map(np.testing.assert_array_equal, run(), whole)
    monkeypatch.setattr(simulated_clips, "drawn_motions", None)  # what is simulated is not drawn again
    jax.tree.map(np.testing.assert_array_equal, run(), whole)
    with pytest.raises(ValueError, match=r"another run \(simulation\.clips = 3, not 4\)"):
        run(replace(config, simulation=replace(SIMULATION, clips=4)))
