"""PLY: what trimesh writes is read, ASCII and binary; quads, UVs, odd rows; broken files."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from garment_jax.io.formats.ply import read_ply
from tests.reference.scene import make_scene

GARMENT = make_scene(3, 4).garment
HEADER = "ply\nformat {}\ncomment hand made\nelement vertex 4\nproperty float x\nproperty float y\n" + (
    "property float z\nproperty float s\nproperty float t\nelement face {}\n"
)
LIST = "property uchar flags\nproperty list uchar int vertex_indices\nend_header\n"
QUAD = "0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n0 1 0 0 1\n"


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_trimesh_as_the_other_side(tmp_path: Path, encoding: str):
    mesh = trimesh.Trimesh(GARMENT.template, GARMENT.faces, process=False)
    (tmp_path / "a.ply").write_bytes(mesh.export(file_type="ply", encoding=encoding))
    found = read_ply(tmp_path / "a.ply")
    np.testing.assert_allclose(found.vertices, GARMENT.template, atol=1e-7)
    np.testing.assert_array_equal(found.faces, GARMENT.faces)
    assert found.uv is None


def test_polygons_are_fans_and_vertices_carry_uvs(tmp_path: Path):
    text = HEADER.format("ascii 1.0", 2) + LIST + QUAD + "9 4 0 1 2 3\n9 3 0 1 2\n"
    (tmp_path / "a.ply").write_text(text)
    found = read_ply(tmp_path / "a.ply")
    assert found.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2]]
    assert found.uv is not None
    assert found.uv.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]


@pytest.mark.parametrize("order", ["little", "big"])
def test_binary_rows_of_different_lengths(tmp_path: Path, order: str):
    end = "<" if order == "little" else ">"
    head = (HEADER.format(f"binary_{order}_endian 1.0", 2) + LIST).encode()
    points = np.array([[float(x) for x in line.split()] for line in QUAD.splitlines()], end + "f4").tobytes()
    rows = [bytes([9, len(c)]) + np.array(c, end + "i4").tobytes() for c in ([0, 1, 2, 3], [2, 1, 0])]
    (tmp_path / "a.ply").write_bytes(head + points + b"".join(rows))
    assert read_ply(tmp_path / "a.ply").faces.tolist() == [[0, 1, 2], [0, 2, 3], [2, 1, 0]]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is no PLY file"),
        ("ply\nformat ascii 1.0\n", "is no PLY file: its header is missing or has no end"),
        (HEADER.format("ascii 1.0", 10**12) + LIST + QUAD, "announces 1000000000004 rows in the"),
        (HEADER.format("ascii 1.0", -3) + LIST + QUAD, "announces 1 rows"),
        (HEADER.format("utf8 1.0", 1) + LIST + QUAD, "header says 'format utf8 1.0'"),
        (
            HEADER.format("ascii 1.0", 1) + "property list nan\nend_header\n",
            "says 'property list nan'",
        ),
        (HEADER.format("ascii 1.0", 2) + LIST + QUAD + "9 3 0 1 2\n", "is cut short or damaged"),
        (HEADER.format("ascii 1.0", 1) + LIST + QUAD + "9 3 0 1\n", "is cut short or damaged"),
        (HEADER.format("ascii 1.0", 1) + LIST + QUAD + "9 3 0 1 x\n", "is cut short or damaged"),
        (HEADER.format("ascii 1.0", 1) + LIST + QUAD + "9 3 0 1 4\n", "not among its 4"),
        (HEADER.format("ascii 1.0", 1) + LIST + QUAD + "9 3 0 1 nan\n", "not among its 4"),
        (HEADER.format("binary_little_endian 1.0", 1) + LIST + QUAD, "is cut short or damaged"),
        (HEADER.format("ascii 1.0", 0) + "end_header\n" + QUAD, "holds no vertices x y z with faces"),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, text: str, sentence: str):
    (tmp_path / "a.ply").write_text(text)
    with pytest.raises(ValueError, match=sentence):
        read_ply(tmp_path / "a.ply")


TRIANGLE = np.array([[0, 1, 0], [1, 1, 0], [1, 0, 0.5]])


def triangle(end: str, mark: bytes = b"") -> bytes:
    lines = ["ply", "format ascii 1.0", "element vertex 3", *(f"property float {axis}" for axis in "xyz")]
    lines += ["element face 1", "property list uchar int vertex_index", "end_header"]
    lines += ["0 1 0", "", "1 1 0", "1 0 0.5", "3 0 1 2", "more than announced"]
    return mark + end.join(lines).encode()


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"], ids=["plain", "mark"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"], ids=["LF", "CRLF", "CR"])
def test_lines_end_as_they_like(tmp_path: Path, end: str, mark: bytes):
    (tmp_path / "a.ply").write_bytes(triangle(end, mark))
    found = read_ply(tmp_path / "a.ply")
    np.testing.assert_array_equal(found.vertices, TRIANGLE)
    assert found.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (b"1 0 0.5", b"1 nan 0", "vertex 2 is .*not finite; export it again"),
        (b"1 0 0.5", b"1 1e39 0", "vertex 2 is .*inf.*not finite"),
        (b"1 0 0.5", b"1 " + b"1" * 2**20 + b" 0", "is cut short or damaged after its header"),
        (b"1 0 0.5", b"1 " * 2**20, "is cut short or damaged after its header"),
        (b"3 0 1 2", b"3 0 1 0.5", "a face names a vertex that is not among its 3"),
        (b"3 0 1 2", b"-3 0 1 2", "is cut short or damaged after its header"),
        (b"3 0 1 2", b"1e300 0 1 2", "is cut short or damaged after its header"),
        (b"vertex 3", b"vertex " + b"9" * 5000, "the PLY header says 'element vertex 9+'"),
        (b"float y", b"float x", "an element has no properties, or one twice"),
        (b"float x", b"list uchar float x", "is cut short or damaged|holds no vertices x y z"),
        (b"end_header", b"comment " + b"x" * 70_000 + b"\nend_header", "header is missing or has no end"),
    ],
)
def test_damage_is_a_sentence(tmp_path: Path, old: bytes, new: bytes, sentence: str):
    (tmp_path / "a.ply").write_bytes(triangle("\n").replace(old, new))
    with pytest.raises(ValueError, match=sentence):
        read_ply(tmp_path / "a.ply")
