"""Folders of OBJ or PLY: natural order, constant topology, one kind."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from garment_jax.io.formats.any_mesh_cache import read_cache
from garment_jax.io.formats.obj import obj_faces, write_obj
from garment_jax.io.formats.obj_sequence import frame_files
from tests.reference.scene import make_scene

GARMENT = make_scene(3, 4).garment
FRAMES = GARMENT.template + np.arange(12, dtype=np.float32)[:, None, None]
TAIL = obj_faces(GARMENT.faces, GARMENT.uv, GARMENT.faces_uv)


def write_folder(folder: Path) -> Path:
    for k, V in enumerate(FRAMES):
        write_obj(folder / f"frame_{k}.obj", V, TAIL)  # no leading zeros: 10 sorts before 9 by letters
    return folder


def test_frames_come_in_natural_order(tmp_path: Path):
    cache = read_cache(write_folder(tmp_path))
    assert cache.vertices.shape == FRAMES.shape
    np.testing.assert_array_equal(cache.vertices[:], FRAMES)
    np.testing.assert_array_equal(cache.vertices[9:11], FRAMES[9:11])
    np.testing.assert_array_equal(cache.faces, GARMENT.faces)
    np.testing.assert_array_equal(cache.faces_uv, GARMENT.faces_uv)
    assert (cache.fps, cache.unit, cache.up) == (None, None, None)


def test_names_with_several_numbers_and_other_files(tmp_path: Path):
    names = ["take2_10.obj", "take2_9.obj", "take10_1.obj", "10.obj", "take2_009.obj"]
    for name in [*names, "notes.txt", "take.mtl"]:
        (tmp_path / name).touch()
    found = [file.name for file in frame_files(tmp_path)]
    assert found == ["10.obj", "take2_009.obj", "take2_9.obj", "take2_10.obj", "take10_1.obj"]


def test_ply_folders(tmp_path: Path):
    for k in range(3):
        mesh = trimesh.Trimesh(FRAMES[k], GARMENT.faces, process=False)
        (tmp_path / f"{k}.ply").write_bytes(mesh.export(file_type="ply", encoding="binary"))
    np.testing.assert_allclose(read_cache(tmp_path).vertices[:], FRAMES[:3], atol=1e-6)


def test_the_same_triangles_in_other_words_are_the_same(tmp_path: Path):
    write_folder(tmp_path)
    write_obj(tmp_path / "frame_4.obj", FRAMES[4], obj_faces(GARMENT.faces))
    np.testing.assert_array_equal(read_cache(tmp_path).vertices[4], FRAMES[4])


def test_changing_topology_is_refused(tmp_path: Path):
    cache = read_cache(write_folder(tmp_path))
    write_obj(tmp_path / "frame_4.obj", FRAMES[4], obj_faces(GARMENT.faces[:, [1, 2, 0]]))
    write_obj(tmp_path / "frame_6.obj", FRAMES[6, :-1], obj_faces(GARMENT.faces[:4]))
    with pytest.raises(ValueError, match=r"frame_4\.obj has other triangles than frame_0\.obj"):
        cache.vertices[3:6]
    with pytest.raises(ValueError, match=r"frame_6\.obj has 11 vertices, frame_0\.obj has 12"):
        cache.vertices[6]


def test_folders_that_are_no_animation_are_refused(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match=r"holds no \.obj or \.ply files"):
        read_cache(tmp_path)
    (tmp_path / "a.obj").write_text("v 0 0 0\n")
    with pytest.raises(ValueError, match="holds no faces"):
        read_cache(tmp_path)
    (tmp_path / "a.ply").touch()
    with pytest.raises(ValueError, match="holds OBJ and PLY files"):
        read_cache(tmp_path)
