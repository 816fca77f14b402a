"""Clips straight from the simulator: a function of configuration and seed, prepared as those of files."""

import shutil
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from garment_jax.body.root_frame import heading, to_root
from garment_jax.config import ColumnRnnConfig, Config, SimulationConfig
from garment_jax.dataset.prepared import DataSet, PreparedClip, frames_of, prepare, prepared_in_memory
from garment_jax.dataset.template import ColumnTables, canonical_weights
from garment_jax.model.column_rnn.train_step import ColumnBatch
from garment_jax.simulation import many
from garment_jax.structs import TrainState
from garment_jax.training import column_rnn_stage, pipeline, simulated_clips
from garment_jax.training.checkpoint import Checkpointer
from garment_jax.training.simulated_clips import check_simulation, with_simulated_clips
from tests.animation.tiny_model import CONFIG, SCENE
from tests.reference.scene import make_motion, make_vertices, write_clip
from tests.reference.tiny_column_rnn import COLUMNS

pytest.importorskip("newton")

CLOTH = ("substeps=3", "iterations=3", "linear_iterations=8", "settle=2", "blend=2", "hold=1")
SIMULATION = SimulationConfig(clips=3, longest=7, cloth=CLOTH)
ALONE = replace(CONFIG, data=replace(CONFIG.data, validation=()), simulation=SIMULATION)
CANONICAL = replace(ALONE, generative=replace(ALONE.generative, skin_reach=0.1))


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
    return prepare(folder, CANONICAL, folder / "cache")


def simulated(data: DataSet, config: Config = ALONE) -> list[PreparedClip]:
    options = {"posed": False, "unposed": False, "windows": {"column_rnn": 5}}
    return with_simulated_clips(data, config, say=lambda _: None, **options).train


@pytest.fixture(scope="module")
def made(data: DataSet) -> list[PreparedClip]:
    """Simulated clips; one of the three motions may not be fit to be learnt from."""
    return simulated(data)


def test_a_clip_in_memory_is_prepared_as_one_in_a_file(data: DataSet) -> None:
    motion = make_motion(SCENE, 30, 2)
    V, W = make_vertices(SCENE, motion, 2), canonical_weights(SCENE, CANONICAL)
    clip = prepared_in_memory("2", motion, V, SCENE, data.seeds, W, CANONICAL, unposed=True)
    filed = data.train[4]
    assert (filed.name, filed.mirrored) == ("2", False)
    for part in ("V", "U", "T_tilde"):
        np.testing.assert_allclose(getattr(clip, part), getattr(filed, part), atol=1e-6)
    np.testing.assert_allclose(clip.input.x.M, filed.input.x.M, atol=1e-5)
    bare = prepared_in_memory("2", motion, V, SCENE, data.seeds, None, ALONE, unposed=False)
    assert bare.T_tilde is None
    np.testing.assert_array_equal(bare.U, bare.V)
    np.testing.assert_allclose(bare.V, to_root(V, motion.root, heading(motion.rotations[:, 0])), atol=1e-6)


def test_clips_hang_on_configuration_and_seed_alone_and_bring_mirror_images(data: DataSet, made):
    assert len(made) in (4, 6)
    for a, b in zip(made, simulated(data), strict=True):
        np.testing.assert_array_equal(a.V, b.V)
        np.testing.assert_array_equal(a.input.x.M, b.input.x.M)
    plain, mirrored = made[:2]
    assert (plain.mirrored, mirrored.mirrored) == (False, True)
    np.testing.assert_array_equal(
        frames_of(mirrored, np.array([3]), data)[0, :, 1], plain.V[3, data.mirror, 1]
    )


def test_clips_side_by_side_are_those_one_by_one(
    data: DataSet, made, monkeypatch: pytest.MonkeyPatch
) -> None:
    from garment_jax.simulation.side_by_side import SideBySide

    held = []

    def on_this_cpu(scene, settings, flat, clips, device):
        held.append((clips, device))
        return SideBySide(scene, settings, flat, clips, "cpu")

    monkeypatch.setattr(many, "_side_by_side", on_this_cpu)
    on_gpu = replace(ALONE, simulation=replace(SIMULATION, device="cuda", at_once=2))
    together = simulated(data, on_gpu)
    assert held == [(2, "cuda")]
    for a, b in zip(together, made, strict=True):
        np.testing.assert_allclose(a.V, b.V, atol=2e-3)


def test_no_clip_that_can_be_learnt_from_is_refused(data: DataSet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulated_clips, "shape_faults", lambda scene, motion, V: ["strain"])
    with pytest.raises(ValueError, match="none of 3 simulated clips can be learnt from"):
        simulated(data)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"cloth": ("bendy=1",)}, r"simulation\.cloth 'bendy=1': there is no setting 'bendy'"),
        ({"pattern": "nowhere.npz"}, r"nowhere\.npz is not there; name the file of the flat pattern"),
        ({"longest": 4}, r"column_rnn\.window = 5 frames, but the longest training clip has 4"),
        ({"device": "cuda:9"}, "the device cuda:9 is not there"),
        ({"device": "cuda:9", "cloth": ("self_collision=on",)}, "is simulated on a CPU alone"),
    ],
)
def test_what_cannot_be_simulated_is_refused_before_anything_is_trained(changes: dict, sentence: str) -> None:
    with pytest.raises((ValueError, OSError), match=sentence):
        check_simulation(replace(SIMULATION, **changes), 30.0, {"column_rnn": 5})


def cheap_step(tables: ColumnTables, config: ColumnRnnConfig, optimiser: optax.GradientTransformation):
    """A step that compiles in no time and hangs on batch, key and parameters."""

    @jax.jit
    def step(state: TrainState, batch: ColumnBatch):
        key, used = jax.random.split(state.key)
        move = batch.X_star.mean() + 0.1 * jax.random.normal(used)
        params = jax.tree.map(lambda leaf: 0.9 * leaf + move, state.params)
        return TrainState(params, state.opt_state, key, state.step + 1, state.carry), {"loss": jnp.abs(move)}

    return step


def test_a_column_rnn_learns_from_the_simulator_and_goes_on_to_the_same_bits(
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
    monkeypatch.setattr(simulated_clips, "simulate_many", None)  # a stage that has ended simulates nothing
    jax.tree.map(np.testing.assert_array_equal, run(), whole)
    with pytest.raises(ValueError, match=r"another run \(simulation\.clips = 3, not 4\)"):
        run(replace(config, simulation=replace(SIMULATION, clips=4)))
