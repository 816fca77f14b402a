"""Alembic's times from its container, written by hand here; the rest runs in Blender (tests/exporters)."""

import struct
from pathlib import Path

import pytest

from garment_jax.io.formats.alembic import read_timing
from garment_jax.io.formats.any_mesh_cache import read_cache

IDENTITY = struct.pack("<IdId", 1, 1.0, 1, 0.0)
HEAD = b"Ogawa\xff\0\1"


def archive(samplings: bytes, *, root: int | None = None, children: int = 6) -> bytes:
    """Header, the samplings as data, a root group whose fifth child they are."""
    data = struct.pack("<Q", len(samplings)) + samplings
    offsets = [0, 0, 0, 0, 16 | 1 << 63, 0][:children]
    group = struct.pack(f"<Q{children}Q", children, *offsets)
    return HEAD + struct.pack("<Q", 16 + len(data) if root is None else root) + data + group


def sampling(samples: int, cycle: float, *times: float) -> bytes:
    return struct.pack(f"<IdI{len(times)}d", samples, cycle, len(times), *times)


@pytest.mark.parametrize(
    ("samplings", "expected"),
    [
        (IDENTITY + sampling(9, 0.25, 1.5), (1.5, 0.25, 9)),
        (IDENTITY + sampling(9, 0.25, 1.5) + sampling(3, 0.5, 0.0), (1.5, 0.25, 9)),
        (IDENTITY + sampling(4, 1.797e308, 1.0, 1.5, 2.0, 2.5), (1.0, 0.5, 4)),
    ],
)
def test_times_are_those_of_the_longest_sampling(tmp_path: Path, samplings: bytes, expected: tuple):
    (tmp_path / "a.abc").write_bytes(archive(samplings))
    assert read_timing(tmp_path / "a.abc") == pytest.approx(expected)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "is no Alembic file: it does not begin with Ogawa"),
        (b"\x89HDF\r\n\x1a\n" + bytes(20), "is Alembic's old HDF5 kind"),
        (b"Ogawa\x00" + bytes(20), "was never finished"),
        (archive(IDENTITY)[:30], "is cut short or damaged"),
        (archive(IDENTITY, root=10**12), "is cut short or damaged"),
        (archive(IDENTITY, children=3), "is cut short or damaged"),
        (archive(IDENTITY).replace(struct.pack("<Q", 16 | 1 << 63), b"\xff" * 8), "is cut short or damaged"),
        (archive(IDENTITY).replace(struct.pack("<Q", 24), struct.pack("<Q", 10**15), 1), "is cut short"),
        (archive(sampling(9, 0.25, 1.5)[:-3]), "is cut short or damaged"),
        (archive(sampling(4_000_000_000, 0.25, 1.5)), "announces 4000000000 samples"),
        (archive(sampling(3, 1.797e308, 0.0, 0.1, 0.9)), "is sampled at uneven times"),
    ],
)
def test_broken_files_are_refused_before_blender_is_asked(tmp_path: Path, content: bytes, sentence: str):
    (tmp_path / "a.abc").write_bytes(content)
    with pytest.raises(ValueError, match=sentence):
        read_cache(tmp_path / "a.abc", blender="nowhere")


def test_without_blender_the_remedy_is_said(tmp_path: Path):
    (tmp_path / "a.abc").write_bytes(archive(sampling(9, 0.25, 1.5)))
    with pytest.raises(FileNotFoundError, match="nowhere is no program; install Blender"):
        read_cache(tmp_path / "a.abc", blender="nowhere")
