"""Garments from OBJ files: the vertex order stays, seams keep both texture coordinates."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.io.obj import read_garment, read_group

SQUARE = """# a square of two UV charts
v 0 1 0
v 1 1 0
v 1 0 0
v 0 0 0.5
vt 0 1
vt 1 1
vt 1 0
vt 0 0
vt 0.1 0.9
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "cloth.obj"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_seam_vertex_stays_one_vertex(tmp_path: Path):
    garment = read_garment(
        written(tmp_path, SQUARE + "vn 0 0 1\ng cloth\nf 1/1/1 2/2/1 3/3/1\nf 1/5 3/3 4/4\n")
    )
    np.testing.assert_array_equal(garment.template, [[0, 1, 0], [1, 1, 0], [1, 0, 0], [0, 0, 0.5]])
    np.testing.assert_array_equal(garment.faces, [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_array_equal(garment.faces_uv, [[0, 1, 2], [4, 2, 3]])
    assert len(garment.uv) == 5


def test_polygons_become_fans_and_indices_may_count_from_the_end(tmp_path: Path):
    whole = read_garment(written(tmp_path, SQUARE + "f 1/1 2/2 3/3 4/4\n"))
    np.testing.assert_array_equal(whole.faces, [[0, 1, 2], [0, 2, 3]])
    back = read_garment(written(tmp_path, SQUARE + "f -4/-5 -3/-4 -2/-3 -1/-2\n"))
    np.testing.assert_array_equal(back.faces, whole.faces)
    np.testing.assert_array_equal(back.faces_uv, whole.faces_uv)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (SQUARE, "holds no faces"),
        (SQUARE + "f 1 2 3\n", "line 11: corner '1' has no texture coordinate; unwrap"),
        (SQUARE + "f 1/1 2/2 9/3\n", "line 11: corner '9/3' names a vertex that is not there"),
        (SQUARE + "f 1/1 2/2 0/3\n", "corner '0/3' names a vertex"),
        (SQUARE + "f 1/1 2/2\n", "a face of 2 corners"),
        ("v 0 nan 0\n", "line 1: '0 nan 0' is not 3 finite numbers"),
        ("v 0 1\n", "is not 3 finite numbers"),
        ("vt a b\n", "'a b' is not 2 finite numbers"),
    ],
)
def test_what_is_no_garment_is_refused(tmp_path: Path, text: str, sentence: str):
    with pytest.raises(ValueError, match=sentence):
        read_garment(written(tmp_path, text))


def test_a_group_is_the_vertices_of_its_faces_and_points(tmp_path: Path):
    path = written(tmp_path, SQUARE + "g cloth\nf 1/1 2/2 3/3\ng waist cloth\np 4\nf 1/5 3/3 4/4\n")
    np.testing.assert_array_equal(read_group(path, "waist"), [0, 2, 3])
    np.testing.assert_array_equal(read_group(path, "cloth"), [0, 1, 2, 3])
    with pytest.raises(ValueError, match=r"no group 'belt' with faces or points; its groups: cloth, waist"):
        read_group(path, "belt")


def test_a_missing_file_is_refused(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match=r"no\.obj is not there"):
        read_garment(tmp_path / "no.obj")


def test_the_shared_skirt_is_the_clips_template(shared_data: Path):
    import h5py

    garment = read_garment(shared_data / "skirt" / "skirt.obj")
    with h5py.File(shared_data / "skirt" / "train_salsa_02.h5") as file:
        np.testing.assert_allclose(garment.template, file["template"][()], atol=1e-5)
        np.testing.assert_array_equal(garment.faces, file["faces"][()])
        np.testing.assert_array_equal(garment.faces_uv, file["faces_uv"][()])
        np.testing.assert_allclose(garment.uv, file["uv"][()], atol=1e-5)


@pytest.mark.parametrize("line", ["p 9", "p one", "f 1/1 2/2 /3", "l 0 1"])
def test_a_group_of_vertices_that_are_not_there_is_refused(tmp_path: Path, line: str):
    path = written(tmp_path, SQUARE + f"g waist\n{line}\n")
    with pytest.raises(ValueError, match=r"cloth\.obj line 12: .* names a vertex that is not there \(4 vert"):
        read_group(path, "waist")
