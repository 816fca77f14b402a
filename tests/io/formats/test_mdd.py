"""MDD: bytes by hand, times, round trip, and files that are not what they say."""

import struct
from pathlib import Path

import numpy as np
import pytest

from garment_jax.io.formats.any_mesh_cache import read_cache
from garment_jax.io.formats.mdd import read_mdd_header, write_mdd

FRAMES = np.random.default_rng(0).normal(size=(5, 7, 3)).astype(np.float32)


def test_bytes_are_those_of_the_format(tmp_path: Path):
    write_mdd(tmp_path / "a.mdd", [FRAMES[:2], FRAMES[2:]], 5, 7, fps=4, first_frame=2)
    raw = (tmp_path / "a.mdd").read_bytes()
    assert struct.unpack(">ii5f", raw[:28]) == (5, 7, 0.5, 0.75, 1.0, 1.25, 1.5)
    assert struct.unpack(">105f", raw[28:]) == tuple(FRAMES.ravel().tolist())


@pytest.mark.parametrize("fps", [30.0, 24.0, 120.0, 60.0])
@pytest.mark.parametrize("first", [0, 1001])
def test_round_trip_with_the_rate_as_it_was_meant(tmp_path: Path, fps: float, first: int):
    write_mdd(tmp_path / "a.mdd", [FRAMES], 5, 7, fps=fps, first_frame=first)
    cache = read_cache(tmp_path / "a.mdd")
    np.testing.assert_array_equal(cache.vertices[:], FRAMES)
    np.testing.assert_array_equal(cache.vertices[1:4], FRAMES[1:4])
    np.testing.assert_array_equal(cache.vertices[-1], FRAMES[-1])
    np.testing.assert_array_equal(cache.vertices[::2], FRAMES[::2])
    assert (cache.vertices.shape, cache.fps) == ((5, 7, 3), fps)


def test_a_rate_that_is_no_whole_number_stays(tmp_path: Path):
    many = np.zeros((200, 1, 3), np.float32)
    write_mdd(tmp_path / "a.mdd", [many], 200, 1, fps=30_000 / 1001)
    assert read_cache(tmp_path / "a.mdd").fps == pytest.approx(30_000 / 1001, rel=1e-6)


def test_uneven_times_are_no_rate(tmp_path: Path):
    times = np.array([0, 0.1, 0.3, 0.4, 0.5], ">f4")
    content = struct.pack(">ii", 5, 7) + times.tobytes() + FRAMES.astype(">f4").tobytes()
    (tmp_path / "a.mdd").write_bytes(content)
    assert read_cache(tmp_path / "a.mdd").fps is None
    np.testing.assert_allclose(read_mdd_header(tmp_path / "a.mdd").times, times.astype(float))


@pytest.mark.parametrize("timed", [False, True])
def test_frames_beyond_those_announced_are_left_out_with_a_note(tmp_path: Path, timed: bool):
    """As rows of a BVH are; with a time of its own, and without."""
    write_mdd(tmp_path / "a.mdd", [FRAMES], 5, 7, fps=30)
    stored = (tmp_path / "a.mdd").read_bytes()
    times = stored[8:28] if timed else stored[8:24]
    (tmp_path / "a.mdd").write_bytes(struct.pack(">ii", 4, 7) + times + stored[28:])
    cache = read_cache(tmp_path / "a.mdd")
    np.testing.assert_array_equal(cache.vertices[:], FRAMES[:4])
    assert cache.fps == 30
    assert cache.notes == ("1 frame more than the 4 announced is left out",)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"\0\0", "announces 0 frames of 0 points in its 2 bytes"),
        (struct.pack(">ii", -5, 7), "announces -5 frames of 7 points"),
        (struct.pack(">ii", 5, 7) + bytes(400), "has 408 bytes, but as an MDD file .* take 448"),
        (struct.pack("<ii", 5, 7) + bytes(440), "announces 83886080 frames of 117440512 points"),
        (struct.pack(">ii", 2**31 - 1, 2**31 - 1), "announces 2147483647 frames"),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, content: bytes, sentence: str):
    (tmp_path / "a.mdd").write_bytes(content)
    with pytest.raises(ValueError, match=sentence):
        read_cache(tmp_path / "a.mdd")
