"""PC2: bytes by hand, round trip, and files that are not what they say."""

import struct
from pathlib import Path

import numpy as np
import pytest

from garment_jax.io.formats.any_mesh_cache import read_cache
from garment_jax.io.formats.pc2 import MAGIC, read_pc2_header, write_pc2
from garment_jax.validation.validate import validate_file

FRAMES = np.random.default_rng(0).normal(size=(5, 7, 3)).astype(np.float32)


def test_bytes_are_those_of_the_format(tmp_path: Path):
    path = tmp_path / "a.pc2"
    write_pc2(path, [FRAMES[:2], FRAMES[2:]], 5, 7, first_frame=3)
    raw = path.read_bytes()
    assert struct.unpack("<12siiffi", raw[:32]) == (b"POINTCACHE2\0", 1, 7, 3.0, 1.0, 5)
    assert struct.unpack("<105f", raw[32:]) == tuple(FRAMES.ravel().tolist())
    assert read_pc2_header(path).first_frame == 3


def test_what_was_written_is_read_without_loading_it(tmp_path: Path):
    write_pc2(tmp_path / "a.pc2", [FRAMES], 5, 7)
    cache = read_cache(tmp_path / "a.pc2")
    assert isinstance(cache.vertices, np.memmap)
    np.testing.assert_array_equal(cache.vertices, FRAMES)
    assert cache[1:] == (*(None,) * 6, 1.0, ())


@pytest.mark.parametrize(("said", "frames"), [(0.5, 0.5), (2.0, 2.0), (0.0, 1.0)])
def test_frames_a_sample_are_handed_on(tmp_path: Path, said: float, frames: float):
    """0 is what writers leave that do not know the field."""
    write_pc2(tmp_path / "a.pc2", [FRAMES], 5, 7)
    stored = bytearray((tmp_path / "a.pc2").read_bytes())
    stored[24:28] = struct.pack("<f", said)
    (tmp_path / "a.pc2").write_bytes(stored)
    assert read_cache(tmp_path / "a.pc2").frames_a_sample == frames


@pytest.mark.parametrize("said", [-1.0, float("nan"), float("inf")])
def test_absurd_frames_a_sample_are_refused(tmp_path: Path, said: float):
    write_pc2(tmp_path / "a.pc2", [FRAMES], 5, 7)
    stored = bytearray((tmp_path / "a.pc2").read_bytes())
    stored[24:28] = struct.pack("<f", said)
    (tmp_path / "a.pc2").write_bytes(stored)
    with pytest.raises(ValueError, match="frames a sample; export it again"):
        read_cache(tmp_path / "a.pc2")


def test_another_number_of_frames_is_refused(tmp_path: Path):
    with pytest.raises(ValueError, match="4 frames came, 5 were announced"):
        write_pc2(tmp_path / "a.pc2", [FRAMES[:4]], 5, 7)


def header(version: int = 1, points: int = 7, samples: int = 5, magic: bytes = MAGIC) -> bytes:
    return struct.pack("<12siiffi", magic, version, points, 0.0, 1.0, samples)


@pytest.mark.parametrize(
    ("more", "note"), [(1, "1 frame more than the 5 announced is"), (3, "3 frames more")]
)
def test_frames_beyond_those_announced_are_left_out_with_a_note(tmp_path: Path, more: int, note: str):
    """As rows of a BVH are."""
    (tmp_path / "a.pc2").write_bytes(header() + FRAMES.tobytes() + FRAMES[:more].tobytes())
    cache = read_cache(tmp_path / "a.pc2")
    np.testing.assert_array_equal(cache.vertices[:], FRAMES)
    assert cache.notes[0].startswith(note)
    report = validate_file(tmp_path / "a.pc2")
    assert any(f.check == "frames" and f.value == cache.notes[0] for f in report.findings)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "is no PC2 file: it does not begin with POINTCACHE2"),
        (header()[:20], "is no PC2 file"),
        (header(magic=b"POINTCACHE3\0") + FRAMES.tobytes(), "is no PC2 file"),
        (header(version=7) + FRAMES.tobytes(), "is PC2 version 7, only 1 is known"),
        (header(points=-1) + FRAMES.tobytes(), "announces 5 frames of -1 points"),
        (header(samples=0), "announces 0 frames of 7 points"),
        (header() + FRAMES.tobytes()[:-4], "has 448 bytes, but .* take 452"),
        (header(points=2**31 - 1, samples=2**31 - 1), "announces 2147483647 frames of 2147483647 points"),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, content: bytes, sentence: str):
    (tmp_path / "a.pc2").write_bytes(content)
    with pytest.raises(ValueError, match=sentence):
        read_cache(tmp_path / "a.pc2")
