"""What OBJ's text means, whoever reads it: each spelling of one mesh is the same garment, frame and group."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.io.formats.any_mesh_cache import read_cache
from garment_jax.io.formats.obj import read_obj
from garment_jax.io.formats.obj_statements import read_statements
from garment_jax.io.obj import read_garment, read_group

PLAIN = """v 0 1 0
v 1 1 0
v 1 0 0
v 0 0 0.5
vt 0 1
vt 1 1
vt 1 0
vt 0 0
g cloth
f 1/1 2/2 3/3 4/4
f 1/1 3/3 4/4
"""
POINTS = np.array([[0, 1, 0], [1, 1, 0], [1, 0, 0], [0, 0, 0.5]])
FACES = [[0, 1, 2], [0, 2, 3], [0, 2, 3]]
SPELLINGS = {
    "as it is": PLAIN,
    "lines that go on": PLAIN.replace("2/2 3/3 4/4", "2/2 \\\n3/3\\\n 4/4").replace("v 1 1 0", "v 1 \\\n1 0"),
    "blanks after the backslash": PLAIN.replace("f 1/1 2/2 ", "f 1/1 2/2 \\  \n"),
    "comments": "# a comment \\\n" + PLAIN.replace("\nv 1 0 0", "  # first\nv 1 0 0# \n#v 9 9 9"),
    "tabs and blanks": PLAIN.replace(" ", "\t ").replace("\nv", "\n  v"),
    "counting back": PLAIN.replace("f 1/1 2/2 3/3 4/4", "f -4/-4 -3/-3 -2/-2 -1/-1"),
    "normals": PLAIN.replace("1/1 2/2 3/3 4/4", "1/1/1 2/2/1 3/3/1 4/4/1").replace(
        "g cloth", "vn 0 0 1\ng cloth"
    ),
    "colours": PLAIN.replace("v 1 1 0", "v 1 1 0 0.5 0.5 0.5").replace("v 1 0 0", "v 1 0 0 1.0"),
    "a third texture coordinate": PLAIN.replace("vt 1 1", "vt 1 1 0"),
    "points, lines and what else there is": PLAIN.replace(
        "g cloth", "o Cloth\np 1\nl 1 2 3\nl 1/1 2/2\ns off\nusemtl x\nmtllib a b.mtl\nvp 0\ng cloth"
    ),
    "no line at the end": PLAIN.rstrip(),
    "a backslash at the end": PLAIN.rstrip() + "\\",
    "exponents": PLAIN.replace("v 0 0 0.5", "v 0.0e+00 -0 +5E-1"),
    "faces first": "".join(
        sorted(PLAIN.splitlines(keepends=True), key=lambda line: line[0] != "g" and line[0] != "f")
    ),
}
ENDS = {"LF": "\n", "CRLF": "\r\n", "CR": "\r"}


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"], ids=["plain", "mark"])
@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("spelling", SPELLINGS)
def test_every_spelling_is_one_mesh_to_every_reader(tmp_path: Path, spelling: str, end: str, mark: bytes):
    text = SPELLINGS[spelling].replace("\n", ENDS[end]).encode()
    for name in ("a_1.obj", "a_2.obj"):
        (tmp_path / name).write_bytes(mark + text)
    path = tmp_path / "a_1.obj"
    garment, frame = read_garment(path), read_obj(path)
    for found in (garment.template, frame.vertices):
        np.testing.assert_array_equal(found, POINTS)
    for faces in (garment.faces, garment.faces_uv, frame.faces, frame.faces_uv):
        assert faces is not None
        assert faces.tolist() == FACES
    np.testing.assert_array_equal(garment.uv, [[0, 1], [1, 1], [1, 0], [0, 0]])
    np.testing.assert_array_equal(frame.uv, garment.uv)
    np.testing.assert_array_equal(read_group(path, "cloth"), [0, 1, 2, 3])
    cache = read_cache(tmp_path)
    np.testing.assert_array_equal(cache.vertices[:], [POINTS, POINTS])


def test_frames_may_be_spelt_differently(tmp_path: Path):
    for k, spelling in enumerate(SPELLINGS):
        (tmp_path / f"a_{k}.obj").write_text(SPELLINGS[spelling])
    np.testing.assert_array_equal(read_cache(tmp_path).vertices[:], [POINTS] * len(SPELLINGS))


def test_a_face_that_counts_back_elsewhere_is_another(tmp_path: Path):
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 2 0 0\n"
    (tmp_path / "a_1.obj").write_text(text)
    (tmp_path / "a_2.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 2 0 0\nf -3 -2 -1\n")
    with pytest.raises(ValueError, match=r"a_2\.obj has other triangles than a_1.obj"):
        read_cache(tmp_path).vertices[:]


def test_a_statement_has_the_number_of_its_first_line(tmp_path: Path):
    (tmp_path / "a.obj").write_text("# x\nv 0 \\\n0 0\n\nv 1 1 1\n")
    assert list(read_statements(tmp_path / "a.obj")) == [(2, ["v", "0", "0", "0"]), (5, ["v", "1", "1", "1"])]


MEGABYTE = 2**20
REFUSED = {
    "a long number": ("v 0 0 0\nv 0 " + "1" * MEGABYTE + " 0\n", "line 2 has over 1048576 characters"),
    "a number of 1000 digits": ("v 0 0 0\nv 0 " + "1" * 1000 + " 0\n", "'0 1{40} 0' is not 3 finite"),
    "an index of 1000 digits": (
        "v 0 0 0\nf 1 1 " + "1" * 1000 + "\n",
        "corner '1{40}' names a vertex",
    ),
    "many numbers": ("v 0 0 0\nf " + "1 " * MEGABYTE, "line 2 has over 1048576 characters"),
    "a line that goes on for ever": ("v 0 0 0\nf " + "1 1 1 1\\\n" * 200_000, "line 2 has over 1048576 char"),
    "beyond float32": ("v 0 1e39 0\n", "line 1: '0 1e39 0' is not 3 finite numbers"),
    "beyond float64": ("v 0 1e999 0\n", "line 1: '0 1e999 0' is not 3 finite numbers"),
    "Python's numbers": ("v 0 1_0 0\n", "line 1: '0 1_0 0' is not 3 finite numbers"),
    "Python's indices": ("v 0 0 0\nf 1 1 0_1\n", "line 2: corner '0_1' names a vertex"),
    "an index to nothing": (
        "f 1 2 3\nv 0 0 0\nv 0 0 1\n",
        r"line 1: corner '3' names .*\(2 vertices",
    ),
    "a texture index to nothing": (
        "f 1/1 1/2 1/1\nv 0 0 0\nvt 0 0\n",
        "line 1: corner '1/2' names",
    ),
    "16 bits a character": (
        "v 0 0 0\n".encode("utf-16"),
        "is written in 16-bit characters; save it",
    ),
    "zeros": (bytes(1000), "holds no"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_mesh_is_refused_alike(tmp_path: Path, case: str):
    content, sentence = REFUSED[case]
    (tmp_path / "a.obj").write_bytes(content if isinstance(content, bytes) else content.encode())
    for read in (read_obj, read_garment):
        if read is read_garment and "holds no" not in sentence:
            with pytest.raises(ValueError, match=sentence):
                read_garment(tmp_path / "a.obj", uv_required=False)
        else:
            with pytest.raises(ValueError, match=sentence):
                read(tmp_path / "a.obj")


def test_a_file_that_is_too_large_is_not_opened(tmp_path: Path):
    with (tmp_path / "a.obj").open("wb") as file:
        file.truncate(97 * MEGABYTE)
    with pytest.raises(ValueError, match="has 97 MB, more than the 96 MB that are read"):
        read_garment(tmp_path / "a.obj")


def test_the_case_of_lines_that_go_on(shared_cases: Path):
    folder = shared_cases / "obj_line_continuation"
    garment = read_garment(folder / "skirt.obj")
    assert garment.template.shape == (352, 3)
    frames = read_cache(folder / "frames_crlf")
    np.testing.assert_allclose(frames.vertices[0], garment.template, atol=1e-6)
    np.testing.assert_array_equal(frames.faces, garment.faces)
    np.testing.assert_array_equal(frames.faces_uv, garment.faces_uv)
