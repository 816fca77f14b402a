import dataclasses
import errno
import hashlib
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from garment_jax.body.garment_skinning import garment_transforms, garment_weights
from garment_jax.body.mirror import FLIP, mirror_motion
from garment_jax.body.root_frame import from_root
from garment_jax.config import Config
from garment_jax.dataset.motion_input import motion_input
from garment_jax.dataset.prepared import (
    DataSet,
    frames_of,
    prepare,
    targets_of,
    training_clips,
    unposed_targets_of,
)
from garment_jax.dataset.template import STD_FLOOR
from garment_jax.io import stored_arrays
from garment_jax.io.sequence import open_sequence
from tests.reference import skinning
from tests.reference.scene import make_motion, make_scene, write_clip

SCENE = make_scene(4, 8)
FRAMES = 70  # more than one call of the inverse skinning
BASE = Config()
CONFIG = dataclasses.replace(
    BASE,
    data=dataclasses.replace(BASE.data, validation=("waltz.2",)),
    body=dataclasses.replace(BASE.body, seeds=6, tau=0.1, skin_iterations=2),
)


def write(path: Path, seed: int, scene=SCENE, frames: int = FRAMES, fps: float = 30.0) -> Path:
    motion = make_motion(scene, frames, seed, fps=fps)
    return write_clip(path, seed=seed, scene=scene, motion=motion, encoding="float32")


def with_data(config: Config, **values) -> Config:
    return dataclasses.replace(config, data=dataclasses.replace(config.data, **values))


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Three clips; two names differ only after a dot."""
    folder = tmp_path_factory.mktemp("clips")
    (folder / "train").mkdir()
    for seed, name in enumerate(["samba", "waltz.1", "waltz.2"]):
        write(folder / "train" / f"{name}.h5", seed)
    write(folder / "test.h5", 9)  # beside train/: not to be trained on
    return folder


@pytest.fixture(scope="module")
def data(folder, tmp_path_factory) -> DataSet:
    return prepare(folder, CONFIG, tmp_path_factory.mktemp("cache"))


def test_training_clips_come_with_their_mirror_images_and_validation_is_kept_back(data):
    names = [clip.name for clip in data.train]
    assert names == ["samba", "samba mirrored", "waltz.1", "waltz.1 mirrored"]
    assert [clip.mirrored for clip in data.train] == [False, True, False, True]
    assert [clip.name for clip in data.validation] == ["waltz.2"]
    assert data.fps == 30


def test_vertices_are_the_clips_in_the_root_frame(data, folder):
    for clip in (*data.train[::2], *data.validation):
        with open_sequence(folder / "train" / f"{clip.name}.h5") as sequence:
            world = sequence.read(0, FRAMES)
        back = from_root(clip.V.astype(np.float64), clip.input.root, clip.input.yaw)
        np.testing.assert_allclose(back, world, atol=2e-6)


def test_unposed_targets_are_the_slow_fixed_point(data):
    clip = data.validation[0]
    T = SCENE.garment.template - SCENE.body.joints[0]
    for t in (0, 40, 65, 69):  # of the first call, of both and of the last
        R, shift = clip.input.R_seed[t].astype(float), clip.input.t_seed[t].astype(float)
        x = T.astype(float)
        for _ in range(2):
            W = skinning.softmax_weights(x, data.seeds.points.astype(float), 0.1)
            x = skinning.unskin(clip.V[t].astype(float), W, R, shift)
        np.testing.assert_allclose(clip.T_tilde[t], x, atol=1e-4)


def test_mirrored_frames_are_those_of_the_mirrored_motion(data):
    clip, image = data.train[:2]
    which = np.array([3, 7])
    np.testing.assert_array_equal(frames_of(clip, which, data), clip.V[[3, 7]])
    assert data.mirror is not None
    for of in (frames_of, targets_of, unposed_targets_of):
        X, X_m = of(clip, which, data), of(image, which, data)
        for i, partner in enumerate(data.mirror):
            np.testing.assert_allclose(X_m[:, i], X[:, partner] * FLIP, atol=1e-7)
    motion = mirror_motion(make_motion(SCENE, FRAMES, 0), SCENE.body)
    expected = motion_input(motion, SCENE, data.seeds, CONFIG.body.motion_joints)
    np.testing.assert_allclose(image.input.x.M, expected.x.M, atol=1e-5)


@pytest.fixture(scope="module")
def kicks(tmp_path_factory) -> tuple[DataSet, DataSet]:
    """A clip in which a leg carries the cloth, prepared for the root frame and for canonical pose."""
    folder = tmp_path_factory.mktemp("kicks")
    motion = make_motion(SCENE, FRAMES, 4, legs=1.9)
    write_clip(folder / "kicks.h5", seed=4, scene=SCENE, motion=motion, encoding="float32")
    plain = with_data(CONFIG, validation=())
    generative = dataclasses.replace(CONFIG.generative, skin_reach=0.1)
    return tuple(
        prepare(folder, config, folder / "cache")
        for config in (plain, dataclasses.replace(plain, generative=generative))
    )


def test_canonical_targets_posed_by_the_joints_are_the_clip_and_its_mirror_image(kicks):
    W = garment_weights(SCENE, reach=0.1, mirrored=True)
    plain, canonical = kicks
    for k, clip in enumerate(canonical.train):
        R, t = garment_transforms(clip.motion, SCENE)
        carried = np.abs(R - np.eye(3)).max(axis=(1, 2, 3))
        for frame in (int(carried[:64].argmax()), 64 + int(carried[64:].argmax())):
            which = np.array([frame])
            U = targets_of(clip, which, canonical)[0].astype(float)
            V = frames_of(clip, which, canonical)[0]
            np.testing.assert_allclose(skinning.skin(U, W, R[frame], t[frame]), V, atol=1e-4)
            np.testing.assert_array_equal(V, frames_of(plain.train[k], which, plain)[0])
        assert np.abs(clip.U - clip.V).max() > 0.05


def test_statistics_of_canonical_clips_are_of_what_the_networks_see(kicks):
    plain, canonical = kicks
    U = np.concatenate([targets_of(clip, np.arange(FRAMES), canonical) for clip in canonical.train])
    deviation = U.reshape(-1, 3).std(axis=0, dtype=float)
    np.testing.assert_allclose(canonical.statistics.map_std, deviation, rtol=1e-4)
    assert np.abs(canonical.statistics.map_std - plain.statistics.map_std).max() > 1e-3
    np.testing.assert_array_equal(canonical.statistics.motion_mean, plain.statistics.motion_mean)
    assert all(clip.U is clip.V for clip in plain.train)


def test_statistics_are_over_training_frames_and_their_mirror_images_alone(data):
    V = np.concatenate([frames_of(clip, np.arange(FRAMES), data) for clip in data.train]).reshape(-1, 3)
    M = np.concatenate([clip.input.x.M for clip in data.train])
    found = data.statistics
    np.testing.assert_allclose(found.map_mean, V.mean(axis=0, dtype=float), atol=1e-5)
    np.testing.assert_allclose(found.map_std, V.std(axis=0, dtype=float), rtol=1e-4)
    np.testing.assert_allclose(found.motion_mean, M.mean(axis=0), atol=1e-5)
    np.testing.assert_allclose(found.motion_std, np.maximum(M.std(axis=0), STD_FLOOR), rtol=1e-4)
    np.testing.assert_array_equal(found.motion_low, M.min(axis=0))
    np.testing.assert_array_equal(found.motion_high, M.max(axis=0))


def test_large_arrays_stay_on_disk(data):
    for clip in (*data.train, *data.validation):
        assert isinstance(clip.V, np.memmap)
        assert isinstance(clip.T_tilde, np.memmap)
        assert not clip.V.flags.writeable


def test_the_cache_is_used_again_until_a_setting_that_shapes_it_changes(folder, tmp_path, capsys):
    first = prepare(folder, CONFIG, tmp_path)
    assert capsys.readouterr().err.count("prepare:") == 3
    assert len(list(tmp_path.glob("*.npy"))) == 6
    assert len(list(tmp_path.iterdir())) == 13  # with their digests, the clips' hashes, nothing half-written
    again = prepare(folder, CONFIG, tmp_path)
    assert "prepare:" not in capsys.readouterr().err
    assert again.content == first.content
    np.testing.assert_array_equal(again.train[0].T_tilde, first.train[0].T_tilde)
    other = dataclasses.replace(CONFIG, body=dataclasses.replace(CONFIG.body, tau=0.05))
    assert prepare(folder, other, tmp_path).content != first.content
    assert capsys.readouterr().err.count("prepare:") == 3


@pytest.mark.parametrize("reach", [0.0, 0.1])
def test_unposed_targets_are_made_when_they_are_wanted(folder, tmp_path, capsys, reach: float):
    generative = dataclasses.replace(CONFIG.generative, skin_reach=reach)
    config = dataclasses.replace(CONFIG, generative=generative)
    without = prepare(folder, config, tmp_path, unposed=False)
    assert all(clip.T_tilde is None for clip in (*without.train, *without.validation))
    assert not list(tmp_path.glob("*T_tilde*"))
    capsys.readouterr()
    later = prepare(folder, config, tmp_path)
    assert capsys.readouterr().err.count("prepare:") == 3
    at_once = prepare(folder, config, tmp_path / "at_once")
    assert later.content == without.content == at_once.content
    for a, b, c in zip(later.train, at_once.train, without.train, strict=True):
        np.testing.assert_array_equal(a.T_tilde, b.T_tilde)
        for name in ("V", "U"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
            np.testing.assert_array_equal(getattr(c, name), getattr(b, name))
    for made, expected in zip(without.statistics, at_once.statistics, strict=True):
        np.testing.assert_array_equal(made, expected)
    capsys.readouterr()
    prepare(folder, config, tmp_path, unposed=False)
    assert "prepare:" not in capsys.readouterr().err


def test_a_copy_of_the_clips_is_the_same_data_and_a_changed_clip_is_not(folder, tmp_path, capsys):
    first = prepare(folder, CONFIG, tmp_path / "cache")
    shutil.copytree(folder, tmp_path / "copy", copy_function=shutil.copy)  # without their times
    assert capsys.readouterr().err.count("prepare:") == 3
    again = prepare(tmp_path / "copy", CONFIG, tmp_path / "cache")
    assert again.content == first.content
    assert "prepare:" not in capsys.readouterr().err
    path = write(tmp_path / "copy" / "train" / "samba.h5", 7)
    assert prepare(tmp_path / "copy", CONFIG, tmp_path / "cache").content != first.content, path
    assert capsys.readouterr().err.count("prepare:") == 1


@pytest.mark.parametrize("part", ["V", "T_tilde"])
def test_a_cache_with_frames_of_zeros_is_made_anew(folder, tmp_path, capsys, part: str):
    """Two trainings wrote one temporary file, and one was killed: shape and type are right."""
    before = np.array(getattr(prepare(folder, CONFIG, tmp_path).train[0], part))
    path = next(tmp_path.glob(f"samba-*.{part}.npy"))
    array = np.load(path, mmap_mode="r+")
    array[3:] = 0
    array.flush()
    capsys.readouterr()
    np.testing.assert_array_equal(getattr(prepare(folder, CONFIG, tmp_path).train[0], part), before)
    assert capsys.readouterr().err.count("prepare:") == 1


def test_an_array_is_proven_by_its_digest_whatever_windows_it_was_written_in(tmp_path):
    rng = np.random.default_rng(0)
    X, last = rng.normal(size=(10, 5, 3)).astype(np.float32), rng.normal(size=(4, 5, 3)).astype(np.float32)
    path = tmp_path / "new" / "array.npy"
    with stored_arrays.stored_arrays({"V": path}, X.shape) as arrays:
        arrays["V"].write(0, X[:4])
        arrays["V"].write(4, X[4:8])
        arrays["V"].write(6, last)  # begins within the window before, and has the last word
        assert not path.exists()
    expected = np.concatenate([X[:6], last])
    found = stored_arrays.stored_array(path, X.shape)
    np.testing.assert_array_equal(found, expected)
    digest = hashlib.sha256(expected.tobytes()).hexdigest()
    assert (tmp_path / "new" / "array.npy.sha256").read_text() == digest + "\n"
    assert stored_arrays.stored_array(path, (9, 5, 3)) is None
    (tmp_path / "new" / "array.npy.sha256").unlink()
    assert stored_arrays.stored_array(path, X.shape) is None  # of an older version, or killed between the two


@pytest.mark.parametrize("damage", [b"", b"\x93NUMPY", None], ids=["empty", "begun", "cut"])
def test_a_damaged_cache_is_made_anew(folder, tmp_path, capsys, damage: bytes | None):
    before = prepare(folder, CONFIG, tmp_path).train[0]
    T_tilde = np.array(before.T_tilde)
    path = next(tmp_path.glob("samba-*.T_tilde.npy"))
    path.write_bytes(path.read_bytes()[:-9] if damage is None else damage)
    capsys.readouterr()
    after = prepare(folder, CONFIG, tmp_path).train[0]
    np.testing.assert_array_equal(after.T_tilde, T_tilde)
    assert capsys.readouterr().err.count("prepare:") == 1


def test_a_full_disk_leaves_a_sentence_and_nothing_half_written(folder, tmp_path, monkeypatch):
    """Without its room a memory-mapped file ends the process with a bus error, where it is written to."""
    if not hasattr(os, "posix_fallocate"):
        pytest.skip("no way to ask for room here")

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(OSError, match=r"could not be written to .* \(No space left on device\); free"):
        prepare(folder, CONFIG, tmp_path)
    assert not [*tmp_path.glob(".*.partial"), *tmp_path.glob("*.npy*")]


def test_an_array_has_its_room_on_the_disk_before_it_is_filled(tmp_path):
    if not hasattr(os, "posix_fallocate"):
        pytest.skip("no way to ask for room here")
    stored_arrays._reserved(tmp_path / "array", (1000, 100, 3))
    stat = (tmp_path / "array").stat()
    assert stat.st_blocks * 512 >= stat.st_size > 1_200_000


@pytest.mark.parametrize("number", [errno.EOPNOTSUPP, errno.EINVAL])
def test_a_disk_that_cannot_reserve_will_do(tmp_path, monkeypatch, number: int):
    def unknown(*_):
        raise OSError(number, "not known here")

    monkeypatch.setattr(os, "posix_fallocate", unknown, raising=False)
    assert stored_arrays._reserved(tmp_path / "array", (2, 3)).shape == (2, 3)


def test_without_mirroring_there_are_no_images_and_a_lopsided_garment_will_do(folder, tmp_path):
    data = prepare(folder, with_data(CONFIG, mirror=False), tmp_path)
    assert [clip.name for clip in data.train] == ["samba", "waltz.1"]
    assert data.mirror is None
    assert data.statistics.map_mean[0] == pytest.approx(data.train[0].V[..., 0].mean(), abs=0.1)


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(ValueError, match="holds no training clips"):
        prepare(tmp_path, CONFIG, tmp_path / "cache")


def test_an_unknown_validation_clip_and_a_set_without_training_are_refused(folder):
    with pytest.raises(ValueError, match=r"names 'tango', which .* it has samba, waltz\.1, waltz\.2"):
        training_clips(folder, ["tango"])
    with pytest.raises(ValueError, match="names every clip"):
        training_clips(folder, ["samba", "waltz.1", "waltz.2"])


def test_without_a_train_folder_the_folder_itself_is_read(tmp_path):
    write(tmp_path / "solo.h5", 0, frames=3)
    assert [path.stem for path in training_clips(tmp_path, [])] == ["solo"]


FEWER = SCENE.pins._replace(vertices=SCENE.pins.vertices[1:], weights=SCENE.pins.weights[1:])
OTHER_BODY = SCENE._replace(body=SCENE.body._replace(vertices=SCENE.body.vertices + np.float32(0.01)))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"scene": make_scene(5, 8)}, "garment vertices"),
        ({"scene": OTHER_BODY}, r"has another body than .*a\.h5; train"),
        (
            {"scene": SCENE._replace(pins=FEWER)},
            r"b\.h5 has other pins than .*a\.h5; import the clips of one training",
        ),
        ({"scene": SCENE._replace(collider=None)}, r"b\.h5 has another collider than .*a\.h5"),
        ({"fps": 60.0}, r"60 fps and .*a\.h5 30"),
    ],
    ids=["garment", "body", "pins", "collider", "fps"],
)
def test_clips_that_do_not_fit_each_other_are_refused(tmp_path, change, sentence):
    write(tmp_path / "a.h5", 0, frames=5)
    write(tmp_path / "b.h5", 1, frames=5, **change)
    with pytest.raises(ValueError, match=sentence):
        prepare(tmp_path, with_data(CONFIG, validation=()), tmp_path / "cache")
