"""Which clips are simulated, and with which settings."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from garment_jax.embedded.mannequin import make_mannequin
from garment_jax.simulation.command import (
    bvh_jobs,
    cloth_settings,
    embedded_jobs,
    read_pattern,
    varied_jobs,
)
from garment_jax.simulation.settings import ClothSettings
from garment_jax.structs import RiggedBody
from tests.reference.scene import make_scene, write_clip


@pytest.fixture(scope="module")
def body() -> RiggedBody:
    return make_mannequin(0.03)


def test_embedded_clips_are_one_of_each_kind_and_a_dance_of_a_quarter(body):
    jobs = embedded_jobs(body, frames=900, fps=30.0, seed=0)
    assert [job.name for job in jobs][:2] == ["walk_01", "turn_01"]
    assert len({job.name.split("_0")[0] for job in jobs}) == 7
    assert sum(len(job.motion.root) for job in jobs) == 900
    assert [job.split for job in jobs] == ["train"] * 6 + ["test"]
    assert len(jobs[-1].motion.root) == 225


def test_more_frames_are_more_clips_and_other_gestures(body):
    jobs = embedded_jobs(body, frames=1_200, fps=30.0, seed=0)
    first, second = (next(job.motion for job in jobs if job.name == f"walk_0{k}") for k in (1, 2))
    assert len(jobs) == 9
    shared = min(len(first.root), len(second.root))
    assert np.abs(first.rotations[:shared] - second.rotations[:shared]).max() > 0.05


def test_the_same_seed_is_the_same_motion_and_another_is_not(body):
    one, again, other = (embedded_jobs(body, frames=80, fps=30.0, seed=s)[0].motion for s in (3, 3, 4))
    np.testing.assert_array_equal(one.rotations, again.rotations)
    assert np.abs(one.rotations - other.rotations).max() > 1e-3


def test_too_few_frames_are_refused(body):
    with pytest.raises(ValueError, match="--frames 20 are too few to train and to test on; ask for 80"):
        embedded_jobs(body, frames=20, fps=30.0, seed=0)


def test_settings_are_parsed_by_their_types():
    settings = cloth_settings(["bend=5e-4", "iterations=4", "self_collision=on", "air=off"])
    assert settings == ClothSettings(bend=5e-4, iterations=4, self_collision=True, air=False)


@pytest.mark.parametrize(
    ("pair", "sentence"),
    [
        ("weight=3", "there is no setting 'weight'; choose of fps, substeps"),
        ("bend=soft", "'bend=soft' needs a number"),
        ("iterations=2.5", "needs a whole number, such as iterations=10"),
        ("air=maybe", "'air=maybe' is a switch; write on or off"),
        ("density=-1", "density=-1.0 must be more than 0"),
    ],
)
def test_settings_that_mean_nothing_are_refused(pair: str, sentence: str):
    with pytest.raises(ValueError, match=sentence):
        cloth_settings([pair])


def test_bvh_files_that_are_not_there_are_refused(tmp_path: Path, body):
    with pytest.raises(FileNotFoundError, match="holds no BVH files"):
        bvh_jobs([tmp_path], body, fps=30.0)
    (tmp_path / "walk.bvh").write_text("HIERARCHY")
    with pytest.raises(ValueError, match="--test run: there is no such motion; there are walk"):
        bvh_jobs([tmp_path], body, fps=30.0, test=["run"])


def test_varied_clips_are_seeded_and_named_after_theirs(tmp_path: Path):
    for name, seed in (("polka", 1), ("waltz", 2)):
        write_clip(tmp_path / f"{name}.h5", 40, seed, attributes={"name": name})
    scene, jobs = varied_jobs([tmp_path], copies=2, seed=0)
    assert [job.name for job in jobs] == ["polka_v1", "polka_v2", "waltz_v1", "waltz_v2"]
    assert {job.split for job in jobs} == {"train"}
    assert len(scene.body.joint_names) == 22
    again = varied_jobs([tmp_path / "waltz.h5"], copies=1, seed=0)[1][0].motion
    np.testing.assert_array_equal(jobs[2].motion.rotations, again.rotations)
    other = varied_jobs([tmp_path / "waltz.h5"], copies=1, seed=1)[1][0].motion
    assert len(other.root) != len(again.root) or np.abs(other.root - again.root).max() > 1e-3


def test_clips_of_two_scenes_are_not_varied_together(tmp_path: Path):
    write_clip(tmp_path / "a.h5", 12)
    write_clip(tmp_path / "b.h5", 12, scene=make_scene(6, 12))
    with pytest.raises(ValueError, match=r"b\.h5 has another garment or body than .*a\.h5; vary them"):
        varied_jobs([tmp_path], copies=1, seed=0)
    empty = tmp_path / "none"
    empty.mkdir()
    with pytest.raises(FileNotFoundError, match="holds no clips"):
        varied_jobs([empty], copies=1, seed=0)


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_a_pattern_is_read_and_its_absence_named(tmp_path: Path, suffix: str):
    pattern = np.arange(12.0).reshape(6, 2)
    whole, empty = tmp_path / f"whole{suffix}", tmp_path / f"empty{suffix}"
    for path, key in ((whole, "flat" if suffix == ".npz" else "rest_uv_metres"), (empty, "other")):
        if suffix == ".npz":
            np.savez(path, **{key: pattern})
        else:
            with h5py.File(path, "w") as file:
                file[key] = pattern
    np.testing.assert_array_equal(read_pattern(whole), pattern)
    with pytest.raises(ValueError, match="holds no array"):
        read_pattern(empty)
    with pytest.raises(FileNotFoundError, match="name the file of the flat pattern"):
        read_pattern(tmp_path / f"missing{suffix}")
