"""Wavefront OBJ both ways, vertex order kept: positions, triangles and, where there are some, UVs.

A garment's template (`io/obj.py`) and a frame of an animation are read by the same rules; a frame may have
no texture coordinates.
"""

import hashlib
from array import array
from pathlib import Path
from typing import NamedTuple

import numpy as np

from garment_jax.io.formats.obj_statements import index_of, number_of, read_statements, shown
from garment_jax.io.formats.ply import Mesh
from garment_jax.io.formats.polygon_fans import fan_corners

HEAD = "# garment_jax\n"  # how a file begins that is written here
_LARGEST = float(np.finfo(np.float32).max)


class ObjMesh(NamedTuple):
    """One mesh as an OBJ file has it: its own unit and axes, polygons as fans."""

    vertices: np.ndarray  # [n, 3] float32
    faces: np.ndarray  # [f, 3] int32
    uv: np.ndarray  # [u, 2] float32
    faces_uv: np.ndarray  # [f, 3] int32 indices into uv, -1 for a corner without


class _Farthest(NamedTuple):
    """The largest indices so far and where they stand: (line, corner)."""

    vertex: int = -1
    texture: int = -1
    at: tuple[int, str] = (0, "")
    at_texture: tuple[int, str] = (0, "")


def read_obj(path: str | Path) -> Mesh:
    """Read an OBJ mesh, polygons as fans; the file's own unit and axes.

    UVs only where every corner has one. Raises as `parse_obj`.
    """
    mesh = parse_obj(path)
    if not len(mesh.uv) or (mesh.faces_uv < 0).any():
        return Mesh(mesh.vertices, mesh.faces, None, None)
    return Mesh(*mesh)


def parse_obj(path: str | Path, *, faces_required: bool = False, uv_required: bool = False) -> ObjMesh:
    """Read an OBJ mesh with all that its faces say.

    Raises `FileNotFoundError`, or `ValueError` with the line for numbers that are none, faces of fewer than
    three corners or that name vertices that are not there, and for a file without vertices; without faces
    or texture coordinates where these are required.
    """
    positions, texture = array("f"), array("f")
    counts, corners, corners_uv = array("i"), array("i"), array("i")
    farthest = _Farthest()
    for line, words in read_statements(path):
        keyword = words[0]
        if keyword == "v":
            positions.extend(_numbers(words[1:4], 3, path, line))
        elif keyword == "vt":  # a single coordinate is along u
            texture.extend(_numbers(words[1:3] if len(words) != 2 else [words[1], "0"], 2, path, line))
        elif keyword == "f":
            if len(words) < 4:
                raise ValueError(
                    f"{path} line {line}: a face of {len(words) - 1} corners; remove loose edges and export "
                    "again."
                )
            counts.append(len(words) - 1)
            sizes = (len(positions) // 3, len(texture) // 2)
            for word in words[1:]:
                parts = word.split("/", 2)
                textured = len(parts) > 1 and parts[1] != ""
                if uv_required and not textured:
                    raise ValueError(
                        f"{path} line {line}: corner {shown([word])} has no texture coordinate; unwrap the "
                        "garment's UVs."
                    )
                vertex = index_of(parts[0], sizes[0])
                second = index_of(parts[1], sizes[1]) if textured else -1
                if vertex < 0 or (textured and second < 0):
                    raise ValueError(_not_there(path, line, word, sizes))
                corners.append(vertex)
                corners_uv.append(second)
                if vertex > farthest.vertex:
                    farthest = farthest._replace(vertex=vertex, at=(line, word))
                if second > farthest.texture:
                    farthest = farthest._replace(texture=second, at_texture=(line, word))
    sizes = (len(positions) // 3, len(texture) // 2)
    if farthest.vertex >= sizes[0] > 0:
        raise ValueError(_not_there(path, *farthest.at, sizes))
    if farthest.texture >= sizes[1]:
        raise ValueError(_not_there(path, *farthest.at_texture, sizes))
    if faces_required and not counts:
        raise ValueError(f"{path} holds no faces; export the garment's mesh, triangulated or not.")
    if not positions:
        raise ValueError(f"{path} holds no vertices; it is no OBJ mesh, or it is empty.")
    fans = fan_corners(np.frombuffer(counts, np.int32) if counts else np.zeros(0, np.int32))
    return ObjMesh(
        _rows(positions, np.float32, 3),
        _rows(corners, np.int32, 1)[:, 0][fans],
        _rows(texture, np.float32, 2),
        _rows(corners_uv, np.int32, 1)[:, 0][fans],
    )


class ObjFrame(NamedTuple):
    """The positions of an OBJ file, and what tells its faces from others."""

    vertices: np.ndarray  # [n, 3] float32
    faces: bytes  # a digest of all statements about faces and texture


def read_frame(path: str | Path) -> ObjFrame:
    """Return the positions and a digest of the faces, which are not looked at; raises as `parse_obj`."""
    positions, digest = array("f"), hashlib.blake2b()
    for line, words in read_statements(path):
        keyword = words[0]
        if keyword == "v":
            positions.extend(_numbers(words[1:4], 3, path, line))
        elif keyword in ("f", "vt"):
            text = " ".join(words)
            # what counts back is another vertex elsewhere in the file
            digest.update(f"{text} {len(positions)}\n".encode() if "-" in text else f"{text}\n".encode())
    if not positions:
        raise ValueError(f"{path} holds no vertices; it is no OBJ mesh, or it is empty.")
    return ObjFrame(_rows(positions, np.float32, 3), digest.digest())


def _rows(numbers: array, kind: type[np.generic], width: int) -> np.ndarray:
    return np.array(numbers, kind).reshape(-1, width)


def _numbers(words: list[str], count: int, path: str | Path, line: int) -> list[float]:
    try:
        values = [number_of(word) for word in words]
    except ValueError:
        values = []
    # what float32 cannot hold is no coordinate
    if len(values) != count or not all(-_LARGEST < value < _LARGEST for value in values):
        raise ValueError(
            f"{path} line {line}: {shown(words)} is not {count} finite numbers; export it again."
        )
    return values


def _not_there(path: str | Path, line: int, word: str, sizes: tuple[int, int]) -> str:
    return (
        f"{path} line {line}: corner {shown([word])} names a vertex that is not there ({sizes[0]} vertices "
        f"and {sizes[1]} texture coordinates); export the mesh again."
    )


def obj_faces(faces: np.ndarray, uv: np.ndarray | None = None, faces_uv: np.ndarray | None = None) -> str:
    """Return the lines of an OBJ that stay from frame to frame: texture coordinates and triangles."""
    corners = np.asarray(faces) + 1
    if uv is None or faces_uv is None:
        return ("f %d %d %d\n" * len(corners)) % tuple(corners.ravel().tolist())
    both = np.stack([corners, np.asarray(faces_uv) + 1], axis=2)
    text = ("vt %.9g %.9g\n" * len(uv)) % tuple(np.asarray(uv, np.float64).ravel().tolist())
    return text + ("f %d/%d %d/%d %d/%d\n" * len(both)) % tuple(both.ravel().tolist())


def write_obj(path: str | Path, vertices: np.ndarray, tail: str) -> None:
    """Write a comment, `vertices` `[n, 3]` in their order with nine digits (float32 exactly), then `tail`."""
    numbers = np.asarray(vertices, np.float64).ravel().tolist()
    text = ("v %.9g %.9g %.9g\n" * len(vertices)) % tuple(numbers)
    Path(path).write_text(HEAD + text + tail, encoding="utf-8")
