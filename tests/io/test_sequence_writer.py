"""Writing sequence files: whole or not at all, and refusals before anything is lost."""

import signal
import subprocess
import sys
from pathlib import Path

import h5py
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.io import deferred_errors as guarded_file
from garment_jax.io.sequence import SequenceWriter, open_sequence
from garment_jax.structs import Motion, Scene
from tests.reference.scene import make_motion, make_scene, make_vertices, write_clip


@pytest.fixture
def scene() -> Scene:
    return make_scene()


@pytest.fixture
def motion(scene: Scene) -> Motion:
    return make_motion(scene, 10)


def test_frames_may_come_one_by_one_and_from_the_device(tmp_path, scene, motion):
    V = make_vertices(scene, motion)
    with SequenceWriter(tmp_path / "clip.h5", scene, motion, encoding="float32") as writer:
        writer.append(V[0])
        writer.append(jnp.asarray(V[1:4]))
        writer.append(V[4:])
    with open_sequence(tmp_path / "clip.h5") as sequence:
        np.testing.assert_array_equal(sequence.read(0, 10), V)


def test_attributes_and_extra_values_are_kept(tmp_path, scene, motion):
    depth = np.arange(10, dtype=np.float32)
    attributes = {"name": "dance", "kind": "predicted", "seed": 3}
    with SequenceWriter(tmp_path / "clip.h5", scene, motion, attributes=attributes) as writer:
        writer.append(make_vertices(scene, motion))
        writer.add_per_frame("depth", depth)
    with open_sequence(tmp_path / "clip.h5") as sequence:
        assert sequence.name == "dance"
        assert attributes.items() <= sequence.attributes.items()
        assert sequence.extra_names == ("depth",)
        np.testing.assert_array_equal(sequence.read_extra("depth", 2, 5), depth[2:5])


def test_vertices_are_chunked_by_frames(tmp_path, scene):
    path = write_clip(tmp_path / "clip.h5", 400, scene=scene)
    with h5py.File(path) as file:
        frames, *rest = file["vertices"].chunks
        assert rest == [128, 3]
        assert 100_000 < frames * 128 * 3 * 2 <= 262_144


def test_far_from_the_origin_nothing_is_lost(tmp_path, scene, motion):
    """int16 is relative to the root, so a dance 1 km away is stored with the same 0.025 mm."""
    shift = np.array([1000.0, 0.0, 0.0])
    V = make_vertices(scene, motion).astype(np.float64)
    _write(tmp_path, scene, motion, V)
    with h5py.File(tmp_path / "c.h5") as file:
        near = file["vertices"][()]
    _write(tmp_path, scene, motion._replace(root=motion.root + shift), V + shift)
    with h5py.File(tmp_path / "c.h5") as file:
        np.testing.assert_array_equal(file["vertices"][()], near)


def _write(folder: Path, scene: Scene, motion: Motion, V: np.ndarray, **options) -> None:
    """Save `V` in two pieces, the second from frame 5."""
    with SequenceWriter(folder / "c.h5", scene, motion, **options) as writer:
        writer.append(V[:5])
        writer.append(V[5:])


def _expect_nothing_left(folder: Path) -> None:
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(("written", "sentence"), [(9, "9 frames written of 10"), (11, "frame 10 written")])
def test_another_frame_count_is_refused(tmp_path, scene, motion, written, sentence):
    V = make_vertices(scene, make_motion(scene, written))
    with (
        pytest.raises(ValueError, match=sentence),
        SequenceWriter(tmp_path / "c.h5", scene, motion) as writer,
    ):
        writer.append(V)
    _expect_nothing_left(tmp_path)


def test_another_vertex_count_is_refused(tmp_path, scene, motion):
    V = make_vertices(scene, motion)[:, 1:]
    with pytest.raises(ValueError, match=r"shape \(5, 127, 3\), expected \[k, 128, 3\]"):
        _write(tmp_path, scene, motion, V)
    _expect_nothing_left(tmp_path)


@pytest.mark.parametrize("encoding", ["int16", "float32"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_frames_that_are_not_finite_are_refused(tmp_path, scene, motion, encoding, value):
    V = make_vertices(scene, motion)
    V[7, 3, 1] = value
    with pytest.raises(ValueError, match="vertices of frame 7 are not finite"):
        _write(tmp_path, scene, motion, V, encoding=encoding)
    _expect_nothing_left(tmp_path)


def test_out_of_reach_of_int16_is_refused_and_a_larger_scale_reaches(tmp_path, scene, motion):
    V = make_vertices(scene, motion)
    V[2, 5] = motion.root[2] + np.array([0.0, 2.0, 0.0])
    with pytest.raises(ValueError, match=r"2\.000 m from the root.*reaches 1\.638 m.*encoding='float32'"):
        _write(tmp_path, scene, motion, V)
    _expect_nothing_left(tmp_path)
    _write(tmp_path, scene, motion, V, scale=1e-4)
    with open_sequence(tmp_path / "c.h5") as sequence:
        assert np.abs(sequence.read(0, 10) - V).max() <= 0.5e-4 + 1e-6


def test_unknown_options_are_refused(tmp_path, scene, motion):
    with pytest.raises(ValueError, match=r"scale=0\.0 metres"):
        SequenceWriter(tmp_path / "c.h5", scene, motion, scale=0.0)
    with pytest.raises(ValueError, match="encoding='int8' is unknown"):
        SequenceWriter(tmp_path / "c.h5", scene, motion, encoding="int8")


def test_missing_frame_rate_is_refused(tmp_path, scene, motion):
    with pytest.raises(ValueError, match=r"fps is 0\.0; give the motion"):
        SequenceWriter(tmp_path / "c.h5", scene, motion._replace(fps=0.0))


def test_scene_that_does_not_fit_is_refused_before_writing(tmp_path, scene, motion):
    broken = scene._replace(garment=scene.garment._replace(faces=scene.garment.faces + 1))
    with pytest.raises(ValueError, match="`faces` holds index 128"):
        SequenceWriter(tmp_path / "c.h5", broken, motion)
    _expect_nothing_left(tmp_path)


def test_extra_values_of_other_length_are_refused(tmp_path, scene, motion):
    with (
        pytest.raises(ValueError, match="'depth' has 3 frames, the clip 10"),
        SequenceWriter(tmp_path / "c.h5", scene, motion) as writer,
    ):
        writer.add_per_frame("depth", np.zeros(3))


def test_an_error_keeps_the_older_file(tmp_path, scene, motion):
    """An interrupted run (here after 5 of 10 frames) must not cost the last good prediction."""
    path = write_clip(tmp_path / "c.h5", 4)
    before = path.read_bytes()
    V = make_vertices(scene, motion)
    V[8] = np.nan
    with pytest.raises(ValueError, match="frame 8"):
        _write(tmp_path, scene, motion, V)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_is_refused_before_anything_is_written(tmp_path, scene, motion):
    with (
        pytest.raises(ValueError, match=r"is a folder; name a sequence file"),
        SequenceWriter(tmp_path, scene, motion),
    ):
        pytest.fail("entered")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "sentence"), [(".", "is a folder"), (f"{'c' * 256}", "is a name of 256 bytes, more than 255")]
)
def test_a_name_that_no_file_can_have_is_refused(scene, motion, name, sentence):
    with pytest.raises(ValueError, match=sentence):
        SequenceWriter(name, scene, motion)


def test_the_longest_name_can_be_written(tmp_path):
    assert write_clip(tmp_path / f"{'c' * 252}.h5", 2).is_file()


def test_folder_that_is_a_file_is_refused(tmp_path, scene, motion):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(OSError, match=r"could not be written \(.*\); choose another folder"),
        SequenceWriter(tmp_path / "file/c.h5", scene, motion),
    ):
        pass


_FULL_DISK = """
import resource, sys
from garment_jax.io.sequence import SequenceWriter
from tests.reference.scene import make_motion, make_scene, make_vertices
scene = make_scene(40, 40)
motion = make_motion(scene, 60)
V = make_vertices(scene, motion)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
try:
    with SequenceWriter(sys.argv[1], scene, motion) as writer:
        writer.append(V[:30])
        writer.append(V[30:])
except OSError as error:
    print(error)
"""


@pytest.mark.parametrize("room", [2_000, 50_000, 200_000])
def test_full_disk_is_one_sentence_and_a_living_process(tmp_path, room):
    """In a process of its own: HDF5 itself ends with a segmentation fault when a write fails."""
    command = [sys.executable, "-c", _FULL_DISK, str(tmp_path / "c.h5"), str(room)]
    result = subprocess.run(
        command, capture_output=True, text=True, cwd=Path(__file__).parents[2], check=False
    )
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    assert "could not be written (File too large); nothing was saved" in result.stdout
    assert result.stdout.count("\n") == 1
    _expect_nothing_left(tmp_path)


def test_disk_that_fails_at_the_last_moment_is_noticed(tmp_path, scene, motion, monkeypatch):
    """Network disks report a full disk when the file is forced out, not when it is written."""

    def fail(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(guarded_file.os, "fsync", fail)
    with pytest.raises(OSError, match="No space left on device"):
        write_clip(tmp_path / "c.h5", scene=scene, motion=motion)
    _expect_nothing_left(tmp_path)


def _calls_of_hdf5(monkeypatch: pytest.MonkeyPatch, folder: Path, interrupted: int) -> list[str]:
    """Record the calls of guarded files in `folder`; Ctrl-C comes within the one of this number.

    Not of all: what another test has left open may be closed at any moment.
    """
    made: list[str] = []

    def counted(name: str):
        plain = getattr(guarded_file.GuardedFile, name)

        def call(self, *given):
            if folder in Path(self._raw.name).parents:
                made.append(name)
                if len(made) == interrupted:
                    signal.raise_signal(signal.SIGINT)
            return plain(self, *given)

        return call

    for name in ("write", "seek", "readinto", "truncate", "tell", "flush", "finish"):
        monkeypatch.setattr(guarded_file.GuardedFile, name, counted(name))
    return made


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_within_any_call_of_hdf5_leaves_the_older_file_and_no_other(tmp_path, scene, motion):
    """HDF5 cannot pass an exception on: it went on without the write, and the file looked whole."""
    path = tmp_path / "clip.h5"

    def write(seed: int) -> None:
        with SequenceWriter(path, scene, motion, encoding="float32") as writer:
            writer.append(make_vertices(scene, motion, seed))
            writer.add_per_frame("depth", np.arange(100.0).reshape(10, 10))

    write(0)
    before = path.read_bytes()
    with pytest.MonkeyPatch.context() as patch:
        made = _calls_of_hdf5(patch, tmp_path, interrupted=0)
        write(0)
        calls = len(made)
    assert calls > 50
    for number in range(1, calls + 1):
        with pytest.MonkeyPatch.context() as patch:
            made = _calls_of_hdf5(patch, tmp_path, interrupted=number)
            try:
                write(1)
            except KeyboardInterrupt:
                pass
            else:
                pytest.fail(f"nothing was raised within call {number} of {calls}; made: {made}")
        assert [p.name for p in tmp_path.iterdir()] == ["clip.h5"], number
        assert path.read_bytes() == before, number
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
