"""Which clips are simulated, and with which settings."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from garment_jax.procedural.mannequin import make_mannequin
from garment_jax.simulation.command import (
    check_collider,
    check_numbers,
    check_rest_shape,
    cloth_settings,
    embedded_jobs,
    motion_jobs,
    read_pattern,
)
from garment_jax.simulation.settings import ClothSettings
from garment_jax.structs import RiggedBody
from tests.reference.files import write_bvh
from tests.reference.scene import make_motion, make_scene


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


def test_motions_that_are_not_there_are_refused(tmp_path: Path, body):
    with pytest.raises(FileNotFoundError, match="holds no motions"):
        motion_jobs([tmp_path], body, fps=30.0)
    (tmp_path / "walk.bvh").write_text("HIERARCHY")
    with pytest.raises(ValueError, match="--test run: there is no such motion; there are walk"):
        motion_jobs([tmp_path], body, fps=30.0, test=["run"])


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


def test_a_damaged_pattern_is_refused_in_a_sentence(tmp_path: Path):
    pattern = np.random.default_rng(0).random((2_000, 2))
    for name, write in (("a.npz", lambda path: np.savez(path, flat=pattern)), ("b.h5", write_pattern)):
        path = tmp_path / name
        write(path)
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        with pytest.raises(OSError, match=r"\S*[ab]\.\S+ is (damaged|truncated)"):
            read_pattern(path)
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(OSError, match=r"text\.npz is damaged or no \.npz file"):
        read_pattern(tmp_path / "text.npz")
    np.savez(tmp_path / "objects.npz", flat=np.array([{}], object))
    with pytest.raises(ValueError, match=r"objects\.npz: array 'flat' holds pickled Python objects"):
        read_pattern(tmp_path / "objects.npz")


def write_pattern(path: Path, pattern: object = None) -> None:
    with h5py.File(path, "w") as file:
        file["rest_uv_metres"] = np.random.default_rng(0).random((2_000, 2)) if pattern is None else pattern


@pytest.mark.parametrize(
    ("pattern", "sentence"),
    [
        (np.zeros((6, 3)), r"`flat` has shape \(6, 3\), expected \[u, 2\]"),
        (np.zeros(()), r"`flat` has shape \(\), expected"),
        (np.array([[0.0, 1.0], [np.nan, 0.0]]), "`flat` is not finite in row 1; export it again"),
        (np.array([["a", "b"]]), "`flat` has type <U1; store numbers"),
    ],
)
def test_a_pattern_that_is_no_points_of_the_plane_is_refused(tmp_path: Path, pattern, sentence: str):
    np.savez(tmp_path / "p.npz", flat=pattern)
    with pytest.raises(ValueError, match=r"^\S*p\.npz: " + sentence):
        read_pattern(tmp_path / "p.npz")
    write_pattern(tmp_path / "p.h5", pattern if pattern.dtype.kind == "f" else b"ab")
    with pytest.raises(ValueError, match=r"^\S*p\.h5: `rest_uv_metres` "):
        read_pattern(tmp_path / "p.h5")


def test_the_file_to_repair_is_named(tmp_path: Path):
    scene = make_scene()
    with pytest.raises(ValueError, match=r"p\.npz: the flat pattern has shape \(6, 2\), the garment's UVs"):
        check_rest_shape(scene.garment, np.zeros((6, 2)), Path("p.npz"))
    thin = scene.garment.template.copy()
    thin[scene.garment.faces[7]] = thin[scene.garment.faces[7, 0]]
    garment = scene.garment._replace(template=thin, uv=scene.garment.uv**2)
    with pytest.raises(ValueError, match=r"skirt\.obj: face \d+ of the template has no area; remove it"):
        check_rest_shape(garment, None, Path("skirt.obj"))
    assert scene.collider is not None
    none = scene.collider._replace(faces=scene.collider.faces[:0])
    with pytest.raises(
        ValueError, match=r"solid\.npz: the collider has 0 faces; give it those that the cloth"
    ):
        check_collider(none, Path("solid.npz"))
    hole = scene.collider._replace(faces=scene.collider.faces[1:])
    with pytest.raises(ValueError, match=r"solid\.npz: the collider has 3 edges without .* close its holes"):
        check_collider(hole, Path("solid.npz"))


NUMBERS = {
    "workers": 1,
    "copies": 1,
    "frames": 900,
    "seed": 0,
    "skip": 0,
    "source_fps": None,
}


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("workers", 0, "--workers 0 is too small; give 1 or more"),
        ("workers", -2, "--workers -2 is too small"),
        ("copies", -1, "--copies -1 is too small; give 0 or more"),
        ("frames", 0, "--frames 0 is too small"),
        ("seed", -1, "--seed -1 is too small; give 0 or more"),
        ("skip", -3, "--skip -3 is too small; give 0 or more"),
        ("source_fps", -30.0, r"--source-fps -30\.0 is too small; give 1 or more"),
        ("source_fps", float("nan"), "--source-fps nan is too small"),
        ("spins", float("inf"), "--spins inf is too large; give 100 or less"),
        ("turn", 1e9, r"--turn 1000000000\.0 is too large; give 3600 or less"),
    ],
)
def test_numbers_that_are_too_small_are_refused(name: str, value: float, sentence: str):
    check_numbers(NUMBERS)
    with pytest.raises(ValueError, match=sentence):
        check_numbers(NUMBERS | {name: value})


def test_a_bvh_that_does_not_fit_is_refused_by_file(tmp_path: Path):
    scene = make_scene()
    motion = make_motion(scene, 12)
    write_bvh(tmp_path / "walk.bvh", scene.body, motion)
    with pytest.raises(ValueError, match=r"walk\.bvh: --skip 40 leaves nothing of 12 frames"):
        motion_jobs([tmp_path], scene.body, fps=30.0, skip=40)
    jump = motion.root + np.where(np.arange(12)[:, None] >= 1, 2.0, 0.0)
    write_bvh(tmp_path / "walk.bvh", scene.body, motion._replace(root=jump))
    with pytest.raises(ValueError, match=r"walk\.bvh: the root moves at [\d.]+ m/s in frame 1; check"):
        motion_jobs([tmp_path], scene.body, fps=30.0)
    (job,) = motion_jobs([tmp_path], scene.body, fps=30.0, skip=1)
    assert len(job.motion.root) == 11


def test_one_motion_of_several_that_does_not_fit_leaves_the_others(tmp_path: Path):
    scene = make_scene()
    write_bvh(tmp_path / "walk.bvh", scene.body, make_motion(scene, 12))
    (tmp_path / "bad.bvh").write_text("HIERARCHY")
    said, left_out = [], []
    (job,) = motion_jobs([tmp_path], scene.body, fps=30.0, say=said.append, left_out=left_out)
    assert (job.name, left_out) == ("walk", ["bad"])
    assert said[0].startswith(f"bad: left out: {tmp_path / 'bad.bvh'}")
    with pytest.raises(ValueError, match=r"bad\.bvh"):
        motion_jobs([tmp_path / "bad.bvh"], scene.body, fps=30.0, left_out=left_out)
