"""OBJ: exact both ways, read by trimesh, corners of every kind, broken files."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from garment_jax.io.formats.obj import obj_faces, read_obj, write_obj
from garment_jax.io.obj import read_garment
from tests.reference.scene import make_scene

GARMENT = make_scene(3, 4).garment


def test_float32_survives_and_other_readers_agree(tmp_path: Path):
    V = np.random.default_rng(0).normal(size=GARMENT.template.shape).astype(np.float32)
    write_obj(tmp_path / "a.obj", V, obj_faces(GARMENT.faces, GARMENT.uv, GARMENT.faces_uv))
    found, template = read_obj(tmp_path / "a.obj"), read_garment(tmp_path / "a.obj")
    for mesh in (found, template):
        np.testing.assert_array_equal(mesh.faces_uv, GARMENT.faces_uv)
        np.testing.assert_array_equal(mesh.uv, GARMENT.uv)
        np.testing.assert_array_equal(mesh.faces, GARMENT.faces)
    np.testing.assert_array_equal(found.vertices, V)
    write_obj(tmp_path / "b.obj", V, obj_faces(GARMENT.faces))
    other = trimesh.load_mesh(tmp_path / "b.obj", process=False, maintain_order=True)
    np.testing.assert_allclose(other.vertices, V, atol=1e-8)
    np.testing.assert_array_equal(other.faces, GARMENT.faces)


def test_quads_corners_without_uvs_and_counting_back(tmp_path: Path):
    text = "v 0 0 0\nv 1 0 0 \\\n\nv 1 1 0\nv\t0 1 0\nf -4 -3 -2 -1\nvn 0 0 1\n"
    text += "f 1//1 2//1 3//1\nv 5 5 5\nf -1 1 2\n"
    (tmp_path / "a.obj").write_text(text)
    found = read_obj(tmp_path / "a.obj")
    assert found.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2], [4, 0, 1]]
    assert found.uv is None
    assert len(found.vertices) == 5


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "holds no vertices"),
        ("v 0 0 0\nv 1 nan 0\n", "'1 nan 0' is not 3 finite numbers"),
        ("v 0 0 0\nv 1 0\n", "'1 0' is not 3 finite numbers"),
        ("v 0 zero 0\n", "'0 zero 0' is not 3 finite numbers"),
        ("v 0 0 0\nf 1 1 2\n", "corner '2' names a vertex that is not there"),
        ("v 0 0 0\nf 1 1 0\n", "corner '0' names"),
        ("v 0 0 0\nf -9 1 1\n", "corner '-9' names"),
        ("v 0 0 0\nf 1/1 1/1 1/1\n", "corner '1/1' names .* and 0 texture"),
        ("v 0 0 0\nf a b c\n", "corner 'a' names"),
        ("v 0 0 0\nf 99999999999999999999 1 1\n", "corner '9+' names"),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, text: str, sentence: str):
    (tmp_path / "a.obj").write_text(text)
    with pytest.raises(ValueError, match=sentence):
        read_obj(tmp_path / "a.obj")
