"""An animation as a folder of OBJ or PLY files, one a frame, vertex order and triangles constant."""

import re
from pathlib import Path

import numpy as np

from garment_jax.io.formats.mesh_cache import Frames, MeshCache
from garment_jax.io.formats.obj import read_frame, read_obj
from garment_jax.io.formats.ply import Mesh, read_ply

_KINDS = (".obj", ".ply")


def read_folder(folder: str | Path) -> MeshCache:
    """Open a folder of OBJ or PLY files, one a frame in natural order (frame 10 comes after frame 9).

    Triangles and UVs are those of the first file. Every file's vertex count and triangles are compared with
    them when its frame is read. Raises `FileNotFoundError`, or `ValueError` with the file that does not fit.
    """
    files = frame_files(Path(folder))
    first = _read(files[0])
    faces = read_frame(files[0]).faces if files[0].suffix.lower() == ".obj" else None

    def read(start: int, stop: int) -> np.ndarray:
        shape = (stop - start, *first.vertices.shape)
        frames = np.empty(shape, np.float32)
        for k, file in enumerate(files[start:stop]):
            frames[k] = _positions(file, first, files[0].name, faces)
        return frames

    vertices = Frames((len(files), len(first.vertices), 3), read)
    return MeshCache(vertices, first.faces, first.uv, first.faces_uv, None, None, None)


def frame_files(folder: Path) -> list[Path]:
    """Return a folder's frames in natural order.

    Raises `FileNotFoundError` where there are none, `ValueError` where OBJ and PLY are mixed or two files
    cannot be told apart by their numbers.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder} is no folder; name a folder of OBJ or PLY files, one a frame.")
    found = [file for file in folder.iterdir() if file.suffix.lower() in _KINDS and file.is_file()]
    if not found:
        raise FileNotFoundError(f"{folder} holds no .obj or .ply files; name a folder with one a frame.")
    if len({file.suffix.lower() for file in found}) > 1:
        raise ValueError(f"{folder} holds OBJ and PLY files; keep one kind, one file a frame.")
    return sorted(found, key=_natural)


def _natural(file: Path) -> tuple[list[tuple[int, int, str]], str]:
    """Return a key that sorts numbers within names as numbers; the name itself decides between 01 and 1."""
    parts = re.findall(r"\d+|\D+", file.stem)
    # A ² is a digit to str.isdigit and no number to int: \d and isdecimal agree on what is one.
    return [(0, int(p), "") if p.isdecimal() else (1, 0, p) for p in parts], file.name


def _read(file: Path) -> Mesh:
    mesh = read_obj(file) if file.suffix.lower() == ".obj" else read_ply(file)
    if not len(mesh.faces):
        raise ValueError(f"{file} holds no faces; export the mesh with its faces.")
    return mesh


def _positions(file: Path, first: Mesh, first_name: str, faces: bytes | None) -> np.ndarray:
    """Return a frame's vertices `[n, 3]`, its topology compared with the first file's."""
    if faces is not None:
        frame = read_frame(file)
        if frame.faces == faces and len(frame.vertices) == len(first.vertices):
            return frame.vertices  # the usual case: the same statements need no second look
    mesh = _read(file)
    if len(mesh.vertices) != len(first.vertices):
        raise ValueError(
            f"{file} has {len(mesh.vertices)} vertices, {first_name} has {len(first.vertices)}; export all "
            "frames with the same vertices in the same order."
        )
    if not np.array_equal(mesh.faces, first.faces):
        raise ValueError(
            f"{file} has other triangles than {first_name}; export all frames with the same vertex order, "
            "and nothing that cuts or merges between frames."
        )
    return mesh.vertices
