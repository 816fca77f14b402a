"""Garment templates from Wavefront OBJ files, vertex order kept.

Mesh libraries split a vertex that has two texture coordinates; the garment's own vertices must stay one.
"""

from pathlib import Path

import numpy as np

from garment_jax.io.formats.damage import reads_foreign
from garment_jax.io.formats.obj import parse_obj
from garment_jax.io.formats.obj_statements import index_of, read_statements, shown
from garment_jax.structs import Garment


@reads_foreign
def read_garment(path: str | Path, *, uv_required: bool = True) -> Garment:
    """Read positions, texture coordinates and faces (polygons as fans); lengths as they stand in the file.

    Without `uv_required` a corner may have no texture coordinate: it is -1 in `faces_uv`. Raises
    `FileNotFoundError`, or `ValueError` with the line for what is no garment: no faces, no UVs, an
    index that is not there, a number that is none or not finite.
    """
    mesh = parse_obj(path, faces_required=True, uv_required=uv_required)
    return Garment(mesh.vertices, mesh.faces, mesh.uv, mesh.faces_uv)


@reads_foreign
def read_group(path: str | Path, name: str) -> np.ndarray:
    """Return the vertices, ascending, of the faces and points under the group or object `name`.

    Raises `ValueError` with the names that the file has, or with the line of a vertex that is not there.
    """
    found: dict[str, set[int]] = {}
    current: list[str] = []
    points, farthest, where = 0, -1, (0, "")
    for line, words in read_statements(path):
        keyword = words[0]
        if keyword in ("g", "o"):
            current = words[1:]
        elif keyword == "v":
            points += 1
        elif keyword in ("f", "l", "p"):
            corners = [index_of(word.split("/", 1)[0], points) for word in words[1:]]
            if -1 in corners:
                raise ValueError(_not_there(path, line, words[1 + corners.index(-1)], points))
            if max(corners, default=-1) > farthest:
                farthest = max(corners)
                where = (line, words[1 + corners.index(farthest)])
            for group in current:
                found.setdefault(group, set()).update(corners)
    if farthest >= points:
        raise ValueError(_not_there(path, *where, points))
    if name not in found:
        names = ", ".join(sorted(found))[:400] or "none"
        raise ValueError(f"{path} has no group {name!r} with faces or points; its groups: {names}.")
    return np.array(sorted(found[name]), np.int32)


def _not_there(path: str | Path, line: int, word: str, points: int) -> str:
    return (
        f"{path} line {line}: {shown([word])} names a vertex that is not there ({points} vertices); export "
        "the mesh again."
    )
