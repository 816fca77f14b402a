"""Importing packed clips: exact, whole or not at all, not twice, and refusals by name."""

import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from garment_jax.body.kinematics import joint_positions, pose_points
from garment_jax.io.importer import import_clips
from garment_jax.io.packed_clip import decode_steps
from garment_jax.io.sequence import open_sequence
from tests.io.packed import SCALE, pack, write_packed
from tests.reference.scene import make_motion, make_scene, make_vertices, write_clip

HALF_STEP = SCALE / 2 + 1e-6  # metres: quantisation, and float32 at the clips' distances


def quiet(_: str) -> None:
    """Progress that nobody reads."""


def test_decoding_inverts_packing_in_any_window():
    steps = np.random.default_rng(0).integers(-8_000, 8_000, (11, 7, 3)).astype(np.int32)
    for window in (1, 4, 11, 64):
        np.testing.assert_array_equal(np.concatenate(list(decode_steps(pack(steps), window=window))), steps)


@pytest.mark.parametrize("axis", [0, 1])
def test_sums_beyond_16_bits_are_exact(axis: int):
    """Differences fit into 16 bits, their sum over frames or over vertices does not: 40 × 1,000 steps."""
    ramp = np.arange(1, 41, dtype=np.int32) * 1_000
    steps = np.tile(np.expand_dims(ramp, (1 - axis, 2)), (1, 5, 3) if axis == 0 else (5, 1, 3))
    np.testing.assert_array_equal(np.concatenate(list(decode_steps(pack(steps)))), steps)


def test_imported_clip_equals_its_source(tmp_path: Path):
    write_packed(tmp_path, "train_waltz", 9)
    lines: list[str] = []
    (clip,) = import_clips([tmp_path / "skirt"], tmp_path / "out", progress=lines.append)
    assert clip.path == tmp_path / "out/train/waltz.h5"
    assert lines[0].startswith(f"[1/1] {clip.path} 9 frames")
    scene = make_scene()
    V = make_vertices(scene, make_motion(scene, 9))
    with open_sequence(clip.path) as sequence:
        assert np.abs(sequence.read(0, 9) - V).max() <= HALF_STEP
        assert (sequence.name, sequence.fps, sequence.encoding) == ("waltz", 30.0, "int16")
        expected = {"kind": "simulated", "split": "train", "source": "code"}
        assert expected.items() <= sequence.attributes.items()
        for part, stored in zip(scene, sequence.scene, strict=True):
            for value, read in zip(part, stored, strict=True):
                np.testing.assert_array_equal(value, read)


def test_a_clip_is_imported_once_until_its_content_changes(tmp_path: Path):
    source = write_packed(tmp_path, frames=5)
    out = tmp_path / "out"
    (first,) = import_clips([source], out, progress=quiet)
    written = first.path.stat().st_mtime_ns
    (again,) = import_clips([source], out, progress=quiet)
    assert (first.skipped, again.skipped) == (False, True)
    assert first.path.stat().st_mtime_ns == written
    write_packed(tmp_path, frames=6)
    (changed,) = import_clips([source], out, progress=quiet)
    assert (changed.skipped, changed.frames) == (False, 6)


def test_what_is_no_older_form_of_the_clip_is_not_replaced(tmp_path: Path):
    source = write_packed(tmp_path, frames=5)
    (first,) = import_clips([source], tmp_path / "out", progress=quiet)
    for attributes in ({"kind": "predicted"}, {"source": "another"}, {"imported_from": "clip.pc2"}):
        first.path.unlink()
        path = write_clip(first.path, 6, attributes={"source": "code"} | attributes)
        before = path.read_bytes()
        with pytest.raises(ValueError, match="is there and was not imported from"):
            import_clips([source], tmp_path / "out", progress=quiet)
        assert path.read_bytes() == before


def test_another_programs_file_is_not_replaced(tmp_path: Path):
    source = write_packed(tmp_path, frames=5)
    path = tmp_path / "out/train/waltz.h5"
    path.parent.mkdir(parents=True)
    shutil.copy(source, path)  # a packed clip beside which nothing says whose it is
    before = path.read_bytes()
    with pytest.raises(ValueError, match="is there and was not imported from"):
        import_clips([source], tmp_path / "out", progress=quiet)
    assert path.read_bytes() == before


def test_damaged_import_is_made_again(tmp_path: Path):
    source = write_packed(tmp_path, frames=5)
    (clip,) = import_clips([source], tmp_path / "out", progress=quiet)
    clip.path.write_bytes(clip.path.read_bytes()[:5_000])
    (again,) = import_clips([source], tmp_path / "out", progress=quiet)
    assert not again.skipped
    with open_sequence(clip.path) as sequence:
        assert sequence.frames == 5


def test_body_may_be_named(tmp_path: Path):
    source = write_packed(tmp_path, frames=3)
    (tmp_path / "avatar").rename(tmp_path / "elsewhere")
    with pytest.raises(FileNotFoundError, match=r"its body .*avatar\.npz is not there; name it with --body"):
        import_clips([source], tmp_path / "out", progress=quiet)
    (clip,) = import_clips([source], tmp_path / "out", body=tmp_path / "elsewhere/avatar.npz", progress=quiet)
    assert clip.frames == 3


def _edit_npz(path: Path, change: Callable[[dict], None]) -> None:
    with np.load(path) as file:
        arrays = dict(file)
    change(arrays)
    np.savez(path, **arrays)


def test_files_beside_the_clip_must_be_its_own(tmp_path: Path):
    source = write_packed(tmp_path, frames=3)
    pins = tmp_path / "skirt/pins.npz"
    _edit_npz(pins, lambda a: a.update(pin_weights=np.roll(a["pin_weights"], 1, axis=1)))
    with pytest.raises(
        ValueError, match=r"in frame \d+ a pin is [\d.]+ mm from where the body carries it; use"
    ):
        import_clips([source], tmp_path / "out", progress=quiet)
    _edit_npz(pins, lambda a: a.update(pins=a["pins"] + 1))
    with pytest.raises(ValueError, match=r"other vertices \(16\) than .*pins\.npz names"):
        import_clips([source], tmp_path / "out", progress=quiet)
    _edit_npz(pins, lambda a: a.pop("pin_weights"))
    with pytest.raises(ValueError, match=r"pins\.npz: array 'pin_weights' is missing"):
        import_clips([source], tmp_path / "out", progress=quiet)
    pins.write_bytes(b"PK no archive")
    with pytest.raises(OSError, match=r"pins\.npz is damaged or no \.npz file of plain arrays"):
        import_clips([source], tmp_path / "out", progress=quiet)
    np.savez(pins, pins=np.array([{}], object), pin_weights=np.zeros(1))
    with pytest.raises(ValueError, match=r"pins\.npz: array 'pins' holds pickled Python objects"):
        import_clips([source], tmp_path / "out", progress=quiet)
    pins.unlink()
    with pytest.raises(FileNotFoundError, match=r"simulated with a pins file; put it at"):
        import_clips([source], tmp_path / "out", progress=quiet)
    assert not list((tmp_path / "out").rglob("*.h5"))


def _put(file: h5py.File, name: str, change: Callable) -> None:
    value, attributes = change(file[name][()]), dict(file[name].attrs)
    del file[name]
    file[name] = value
    file[name].attrs.update(attributes)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda file: file.__delitem__("uv"), "dataset `uv` is missing; a packed clip needs"),
        (lambda file: file.attrs.pop("fps"), "attribute fps is missing"),
        (lambda file: file.attrs.update(length_unit="cm"), "length_unit is 'cm'"),
        (lambda file: file["vertices_delta"].attrs.pop("scale"), "attribute scale of `vertices_delta`"),
        (
            lambda file: file["vertices_delta"].attrs.update(scale=2.0),
            "attribute scale of `vertices_delta` is 2.0; give metres per step",
        ),
        (lambda file: file["root"].resize(8, axis=0), r"`vertices_delta` has shape \(9, .*t = 8"),
        (lambda file: _put(file, "vertices_delta", lambda d: d + 0.3), "has type float64; store int16"),
        (lambda file: _put(file, "uv", lambda uv: np.float32(1)), r"`uv` has shape \(\), expected"),
        (lambda file: _put(file, "root", lambda root: root[:, 0]), r"`root` has shape \(9,\), expected"),
    ],
    ids=["no uv", "no fps", "cm", "no scale", "scale of 2", "fewer frames", "floats", "one number", "1 axis"],
)
def test_packed_clip_that_does_not_fit_is_refused(tmp_path: Path, change, sentence: str):
    source = write_packed(tmp_path)
    with h5py.File(source, "r+") as file:
        root = file["root"][()]
        del file["root"]
        file.create_dataset("root", data=root, maxshape=(None, 3))
        change(file)
    with pytest.raises(ValueError, match=sentence):
        import_clips([source], tmp_path / "out", progress=quiet)


def test_links_and_other_whole_numbers_serve(tmp_path: Path):
    source = write_packed(tmp_path, frames=5)
    (first,) = import_clips([source], tmp_path / "first", progress=quiet)
    with h5py.File(source, "r+") as file:
        _put(file, "vertices_delta", lambda delta: delta.astype(">i4"))
        file.move("uv", "elsewhere/uv")
        file["uv"] = h5py.SoftLink("/elsewhere/uv")
    (again,) = import_clips([source], tmp_path / "again", progress=quiet)
    with open_sequence(first.path) as a, open_sequence(again.path) as b:
        np.testing.assert_array_equal(a.read(0, 5), b.read(0, 5))


def test_what_is_no_packed_clip_is_refused(tmp_path: Path):
    clip = write_clip(tmp_path / "clip.h5", 3)
    with pytest.raises(ValueError, match="is a sequence file already"):
        import_clips([clip], tmp_path / "out", progress=quiet)
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="holds no clips"):
        import_clips([tmp_path / "empty"], tmp_path / "out", progress=quiet)


@pytest.mark.parametrize("split", ["../../elsewhere", "", "[1, 2]"])
def test_a_split_is_no_path(tmp_path: Path, split: str):
    write_packed(tmp_path, "train_waltz", 4)
    with h5py.File(tmp_path / "skirt/train_waltz.h5", "r+") as file:
        file.attrs["split"] = split
    with pytest.raises(ValueError, match=r"the clip's split is .* it must be train or test"):
        import_clips([tmp_path / "skirt"], tmp_path / "deep/er/out", progress=quiet)
    assert not (tmp_path / "deep").exists()
    assert not list(tmp_path.rglob("elsewhere"))


def test_a_packed_clip_is_not_written_over(tmp_path: Path):
    write_packed(tmp_path, "train_waltz", 4)
    (tmp_path / "skirt/train").mkdir()
    for path in list((tmp_path / "skirt").iterdir()):
        if path.is_file():  # pins and the like lie beside the clip
            path.rename(path.parent / "train" / path.name.removeprefix("train_"))
    source = tmp_path / "skirt/train/waltz.h5"
    before = source.read_bytes()
    with pytest.raises(ValueError, match=r"waltz\.h5 is what is read; choose another --out"):
        import_clips([source], tmp_path / "skirt", body=tmp_path / "avatar/avatar.npz", progress=quiet)
    assert source.read_bytes() == before


def test_two_clips_of_one_name_are_refused(tmp_path: Path):
    first = write_packed(tmp_path / "a", frames=3)
    second = write_packed(tmp_path / "b", frames=4)
    kept, lost = import_clips([first, second], tmp_path / "out", progress=quiet)
    assert (kept.frames, kept.refused) == (3, "")
    assert "was just written from another clip; rename one" in lost.refused


def test_one_bad_clip_of_three_does_not_stop_the_others(tmp_path: Path):
    paths = [write_packed(tmp_path / name, f"train_{name}", 3) for name in "abc"]
    paths[1].write_bytes(paths[1].read_bytes()[:3000])
    outcomes = import_clips(paths, tmp_path / "out", progress=quiet)
    assert [bool(outcome.refused) for outcome in outcomes] == [False, True, False]
    assert "is truncated" in outcomes[1].refused
    with pytest.raises(OSError, match="is truncated"):
        import_clips([paths[1]], tmp_path / "out", progress=quiet)


def test_shared_clip_decodes_and_its_pins_follow_the_body(shared_data: Path, tmp_path: Path):
    """Against a whole-clip sum in 64 bits; pins within 0.1 mm of their skinned place."""
    source = shared_data / "skirt/test_martial_07.h5"
    with h5py.File(source) as file:
        steps = file["vertices_delta"][()].astype(np.int64).cumsum(axis=1).cumsum(axis=0)
        truth = steps * file["vertices_delta"].attrs["scale"] + file["root"][()].astype(float)[:, None]
    (clip,) = import_clips([source], tmp_path, progress=quiet)
    with open_sequence(clip.path) as sequence:
        scene, motion = sequence.scene, sequence.motion
        V = sequence.read(0, sequence.frames)
    assert V.shape == (360, 2800, 3)
    assert np.abs(V - truth).max() <= 0.026e-3
    assert scene.pins is not None
    positions = joint_positions(motion.rotations, motion.root, scene.body)
    points = scene.garment.template[scene.pins.vertices]
    posed = pose_points(points, scene.pins.weights, motion.rotations, positions, scene.body.joints)
    assert np.abs(posed - V[:, scene.pins.vertices]).max() < 0.1e-3
