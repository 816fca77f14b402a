"""Sequence files: what is written is read, by windows; what does not fit is refused by name."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from garment_jax.io.sequence import DEFAULT_SCALE, SequenceWriter, open_sequence
from garment_jax.structs import Scene
from tests.reference.scene import make_motion, make_scene, make_vertices, write_clip


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return write_clip(tmp_path / "clip.h5", frames=12)


def test_scene_and_motion_survive_exactly(clip: Path):
    scene, motion = make_scene(), make_motion(make_scene(), 12)
    with open_sequence(clip) as sequence:
        for part, stored in zip(scene, sequence.scene, strict=True):
            for value, read in zip(part, stored, strict=True):
                np.testing.assert_array_equal(value, read)
        np.testing.assert_array_equal(sequence.motion.rotations, motion.rotations)
        np.testing.assert_array_equal(sequence.motion.root, motion.root)
        assert (sequence.frames, sequence.fps, sequence.name) == (12, 30.0, "clip")
        assert isinstance(sequence.scene, Scene)


@pytest.mark.parametrize(("encoding", "error"), [("int16", DEFAULT_SCALE / 2 + 1e-6), ("float32", 0.0)])
def test_vertices_survive_within_half_a_step(tmp_path: Path, encoding, error):
    scene = make_scene()
    motion = make_motion(scene, 12)
    path = write_clip(tmp_path / "clip.h5", 12, encoding=encoding)
    with open_sequence(path) as sequence:
        V = sequence.read(0, 12)
        assert V.dtype == np.float32
        assert sequence.encoding == encoding
        assert np.abs(V - make_vertices(scene, motion)).max() <= error


def test_a_second_save_changes_nothing(clip: Path, tmp_path: Path):
    """Quantising quantised positions is exact, so truth and prediction tools may copy clips."""
    with open_sequence(clip) as first:
        with SequenceWriter(tmp_path / "copy.h5", first.scene, first.motion) as writer:
            writer.append(first.read(0, 12))
        with open_sequence(tmp_path / "copy.h5") as second:
            np.testing.assert_array_equal(first.read(0, 12), second.read(0, 12))


def test_windows_equal_the_whole(clip: Path):
    with open_sequence(clip) as sequence:
        whole = sequence.read(0, 12)
        np.testing.assert_array_equal(sequence.read(5, 9), whole[5:9])
        starts, windows = zip(*sequence.windows(5), strict=True)
        assert starts == (0, 5, 10)
        np.testing.assert_array_equal(np.concatenate(windows), whole)


def test_absent_collider_and_pins_are_none(tmp_path: Path):
    scene = make_scene()._replace(collider=None, pins=None)
    with open_sequence(write_clip(tmp_path / "clip.h5", 3, scene=scene)) as sequence:
        assert sequence.scene.collider is None
        assert sequence.scene.pins is None


@pytest.mark.parametrize("window", [(-1, 3), (3, 3), (0, 13)])
def test_frames_outside_the_clip_are_refused(clip: Path, window: tuple[int, int]):
    with open_sequence(clip) as sequence, pytest.raises(ValueError, match=r"of 12; choose"):
        sequence.read(*window)


def test_unknown_extra_is_refused(clip: Path):
    with open_sequence(clip) as sequence, pytest.raises(ValueError, match="no per-frame data named 'depth'"):
        sequence.read_extra("depth", 0, 1)


def _replace(name: str, change: Callable) -> Callable[[h5py.File], None]:
    def damage(file: h5py.File) -> None:
        value = change(file[name][()])
        del file[name]
        file[name] = value

    return damage


def _delete(name: str) -> Callable[[h5py.File], None]:
    return lambda file: file.__delitem__(name)


def _attribute(name: str, value: object = None) -> Callable[[h5py.File], None]:
    return lambda file: file.attrs.pop(name) if value is None else file.attrs.__setitem__(name, value)


def _poke(index: object, value: float) -> Callable[[np.ndarray], np.ndarray]:
    def change(array: np.ndarray) -> np.ndarray:
        array[index] = value
        return array

    return change


def _unscaled(file: h5py.File) -> None:
    del file["vertices"].attrs["scale"]


REFUSALS = {
    "missing dataset": (_delete("rotations"), "`rotations` is missing"),
    "missing vertices": (_delete("vertices"), "`vertices` is missing"),
    "missing in a group": (_delete("pins/weights"), "`pins/weights` is missing"),
    "no uv": (_delete("uv"), "template has no UVs.*unwrap"),
    "no faces_uv": (_delete("faces_uv"), "template has no UVs.*unwrap"),
    "empty uv": (_replace("uv", lambda uv: uv[:0]), "template has no UVs"),
    "uv in metres": (_replace("uv", lambda uv: uv * 3), r"`uv` runs from 0 to 3; scale"),
    "faces of another mesh": (
        _replace("faces", lambda f: f + 100),
        r"`faces` holds index 2\d\d, outside",
    ),
    "faces from 1 … n": (
        _replace("faces_uv", lambda f: f + 1),
        "`faces_uv` holds index 136, outside 0 … 13",
    ),
    "negative index": (_replace("collider/faces", lambda f: f - 1), "`collider/faces` holds index -1"),
    "uv faces fewer": (_replace("faces_uv", lambda f: f[1:]), r"`faces_uv` has shape \(223, 3\).*f = 224"),
    "template flat": (_replace("template", lambda T: T[:, :2]), r"`template` has shape \(128, 2\)"),
    "template of one axis": (_replace("template", lambda T: T[:, 0]), r"`template` has shape \(128,\)"),
    "joints fewer": (_replace("rotations", lambda R: R[:, :21]), r"`rotations` has shape .*j = 22"),
    "frames fewer": (_replace("root", lambda p: p[:-1]), r"`root` has shape \(11, 3\).*t = 12"),
    "vertices fewer": (_replace("vertices", lambda V: V[:, 1:]), r"`vertices` has shape \(12, 127, 3\)"),
    "vertices of 64 bits": (_replace("vertices", lambda V: V.astype(float)), "type float64; store"),
    "no scale": (_unscaled, "scale of int16 `vertices` is None"),
    "no frames": (
        lambda file: [_replace(name, lambda x: x[:0])(file) for name in ("root", "rotations")],
        "0 frames",
    ),
    "parents in disorder": (_replace("body/parents", _poke(3, 9)), "parent must come before"),
    "weights of 2": (_replace("body/skin_weights", lambda W: W * 2), "`body/skin_weights` sums to 2"),
    "root not finite": (_replace("root", _poke((4, 1), np.nan)), "`root` is not finite in row 4"),
    "text for numbers": (_replace("root", lambda p: "none"), "`root` has type text; store numbers"),
    "numbers for text": (_replace("body/joint_names", lambda n: np.arange(22)), "type int64; store text"),
    "one number": (_replace("uv", lambda uv: np.float32(1)), r"`uv` has shape \(\), expected \[u, 2\]"),
    "between two vertices": (
        _replace("faces", lambda f: f + 0.5),
        r"`faces` holds \d+\.5; store whole numbers of 32 bits",
    ),
    "index of 64 bits": (
        _replace("faces", lambda f: f.astype(np.int64) + 2**32),
        r"`faces` holds 42949\d+; store whole numbers of 32 bits",
    ),
    "index in half floats": (_replace("faces", lambda f: f.astype("f2") + 2**15), "`faces` holds index 3"),
    "index of 32 bits and one": (
        _replace("faces", lambda f: np.full(f.shape, 2.0**31, "f4")),
        r"`faces` holds 2147483648.0; store whole numbers of 32 bits",
    ),
    "nothing at all": (
        lambda file: [_delete("uv")(file), file.create_dataset("uv", data=h5py.Empty("f4"))],
        "`uv` is empty; export it again",
    ),
    "collider without faces": (_replace("collider/faces", lambda f: f[:0]), "0 collider faces"),
    "more than memory holds": (
        lambda file: [_delete("root")(file), file.create_dataset("root", (10**15, 3), "f8", chunks=(9, 3))],
        r"dataset 'root' declares 1000000000000000 rows",
    ),
    "no version": (_attribute("schema_version"), "schema_version is None, this release reads 1"),
    "another version": (_attribute("schema_version", 99), "schema_version is 99, this release reads 1"),
    "no fps": (_attribute("fps"), "attribute fps is missing; set it"),
    "fps 0": (_attribute("fps", 0.0), "fps is 0.0; set it"),
    "centimetres": (_attribute("length_unit", "cm"), "length_unit is 'cm'.*convert all lengths to metres"),
    "no unit": (_attribute("length_unit"), "length_unit is None"),
    "Z up": (_attribute("up_axis", "Z"), "up_axis is 'Z'.*turn the clip"),
}


@pytest.mark.parametrize("damage", REFUSALS, ids=str)
def test_what_does_not_fit_is_refused_by_name(clip: Path, damage: str):
    change, sentence = REFUSALS[damage]
    with h5py.File(clip, "r+") as file:
        change(file)
    with pytest.raises(ValueError, match=sentence) as refusal:
        open_sequence(clip)
    assert str(clip) in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_whole_numbers_serve_as_indices_in_any_type(clip: Path):
    with open_sequence(clip) as sequence:
        faces = sequence.scene.garment.faces
    with h5py.File(clip, "r+") as file:
        _replace("faces", lambda f: f.astype(np.float64))(file)
    with open_sequence(clip) as sequence:
        assert sequence.scene.garment.faces.dtype == np.int32
        assert np.array_equal(sequence.scene.garment.faces, faces)


def _said(clip: Path) -> str | None:
    """Return the refusal, None where all of the clip can be read."""
    try:
        with open_sequence(clip) as sequence:
            sequence.read(0, sequence.frames)
    except (ValueError, OSError) as error:
        return str(error)
    return None


def test_any_damage_ends_in_a_sentence(clip: Path):
    whole, said = clip.read_bytes(), []
    for seed in range(150):
        random = np.random.default_rng(seed)
        size = int(random.choice([1, 8, 64, 512]))
        place = int(random.integers(len(whole) - size))
        clip.write_bytes(whole[:place] + random.bytes(size) + whole[place + size :])
        said.append(_said(clip))
    refusals = [sentence for sentence in said if sentence is not None]
    assert 0 < len(refusals) < len(said)  # some bytes matter, others are padding
    assert all(str(clip) in sentence and "\n" not in sentence for sentence in refusals)


def test_packed_clip_is_sent_to_import(tmp_path: Path):
    with h5py.File(tmp_path / "packed.h5", "w") as file:
        file["vertices_delta"] = np.zeros((1, 1, 3), np.int16)
    with pytest.raises(ValueError, match="garment-jax import"):
        open_sequence(tmp_path / "packed.h5")


def test_per_frame_data_with_too_few_rows_are_refused(clip: Path):
    with h5py.File(clip, "r+") as file:
        file["extra/one"], file["extra/few"] = 3.0, np.zeros(7)
    with open_sequence(clip) as sequence:
        for name, shape in (("one", r"\(\)"), ("few", r"\(7,\)")):
            with pytest.raises(
                ValueError, match=rf"`extra/{name}` has shape {shape}, without frame 11; write"
            ):
                sequence.read_extra(name, 0, 12)


def test_a_file_of_another_kind_is_sent_to_import(tmp_path: Path):
    (tmp_path / "walk.bvh").write_text("HIERARCHY")
    with pytest.raises(
        OSError, match=r"walk\.bvh is no sequence file \(\.h5\); make one .* garment-jax import"
    ):
        open_sequence(tmp_path / "walk.bvh")


def test_an_ending_does_not_hide_damage(clip: Path):
    cut = clip.with_name("cut.hdf")
    cut.write_bytes(clip.read_bytes()[:-900])
    with pytest.raises(OSError, match=r"cut\.hdf is truncated; copy"):
        open_sequence(cut)


def test_truncated_file_is_refused_in_a_sentence(clip: Path):
    clip.write_bytes(clip.read_bytes()[: clip.stat().st_size * 2 // 3])
    with pytest.raises(OSError, match=r"clip\.h5 is truncated; copy"):
        open_sequence(clip)


def test_damaged_frames_are_refused_in_a_sentence(clip: Path):
    with h5py.File(clip, "r") as file:
        chunk = file["vertices"].id.get_chunk_info(0)
    content = bytearray(clip.read_bytes())
    content[chunk.byte_offset : chunk.byte_offset + chunk.size] = bytes(chunk.size)
    clip.write_bytes(content)
    with open_sequence(clip) as sequence, pytest.raises(OSError, match="frames 0 … 3 cannot be read"):
        sequence.read(0, 4)


def test_other_files_are_refused_in_a_sentence(tmp_path: Path):
    (tmp_path / "text.h5").write_text("no clip")
    with pytest.raises(OSError, match="is damaged or no HDF5 file"):
        open_sequence(tmp_path / "text.h5")
    with pytest.raises(FileNotFoundError, match="is not there"):
        open_sequence(tmp_path / "nowhere.h5")


def test_a_motion_alone_has_no_vertices(tmp_path: Path):
    scene = make_scene()
    motion = make_motion(scene, 12)
    path = tmp_path / "dance.h5"
    with (
        SequenceWriter(path, scene, motion, encoding="none") as writer,
        pytest.raises(ValueError, match="alone"),
    ):
        writer.append(make_vertices(scene, motion))
    with open_sequence(path) as sequence:
        assert (sequence.encoding, sequence.attributes["kind"], sequence.frames) == ("none", "motion", 12)
        np.testing.assert_array_equal(sequence.motion.rotations, motion.rotations)
        with pytest.raises(
            ValueError, match=r"dance\.h5 holds a motion without garment vertices; animate it"
        ):
            sequence.read(0, 1)


def test_a_simulated_clip_without_vertices_is_refused(clip: Path):
    with h5py.File(clip, "r+") as file:
        del file["vertices"]
    with pytest.raises(ValueError, match="vertices"):
        open_sequence(clip)
