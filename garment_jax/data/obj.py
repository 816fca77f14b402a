"""Garment templates from Wavefront OBJ files, vertex order kept.

Mesh libraries split a vertex that has two texture coordinates; the garment's own vertices must stay one.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from garment_jax.structs import Garment

_LARGEST = 512 * 2**20  # bytes; a garment of 100,000 vertices has about 15 MB


def read_garment(path: str | Path, *, uv_required: bool = True) -> Garment:
    """Read positions, texture coordinates and faces (polygons as fans); lengths as they stand in the file.

    Without `uv_required` a corner may have no texture coordinate: it is -1 in `faces_uv`. Raises
    `FileNotFoundError`, or `ValueError` with the line for what is no garment: no faces, no UVs, an
    index that is not there, a number that is none or not finite.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path} is not there; name the garment's OBJ file.")
    if path.stat().st_size > _LARGEST:
        raise ValueError(f"{path} has {path.stat().st_size / 2**20:.0f} MB; no garment needs that, check it.")
    points: list[list[float]] = []
    uv: list[list[float]] = []
    corners: list[tuple[int, int]] = []
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            words = line.split()
            if not words:
                continue
            where = f"{path} line {number}"
            if words[0] == "v":
                points.append(_numbers(words[1:4], 3, where))
            elif words[0] == "vt":
                uv.append(_numbers(words[1:3], 2, where))
            elif words[0] == "f":
                corners += _fan(words[1:], len(points), len(uv), where, uv_required)
    if not corners:
        raise ValueError(f"{path} holds no faces; export the garment's mesh, triangulated or not.")
    pairs = np.array(corners, np.int32).reshape(-1, 3, 2)
    return Garment(
        np.array(points, np.float32), pairs[..., 0], np.array(uv, np.float32).reshape(-1, 2), pairs[..., 1]
    )


def read_group(path: str | Path, name: str) -> np.ndarray:
    """Return the vertices, ascending, of the faces and points under the group or object `name`.

    Raises `ValueError` with the names that the file has, or with the line of a vertex that is not there.
    """
    found: dict[str, set[int]] = {}
    current: list[str] = []
    points = 0
    with Path(path).open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            words = line.split()
            if not words:
                continue
            if words[0] in ("g", "o"):
                current = words[1:]
            elif words[0] == "v":
                points += 1
            elif words[0] in ("f", "l", "p"):
                corners = {_vertex(word, points, f"{path} line {number}") for word in words[1:]}
                for group in current:
                    found.setdefault(group, set()).update(corners)
    if name not in found:
        names = ", ".join(sorted(found)) or "none"
        raise ValueError(f"{path} has no group {name!r} with faces or points; its groups: {names}.")
    return np.array(sorted(found[name]), np.int32)


def _numbers(words: list[str], count: int, where: str) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError(f"{where}: {' '.join(words)!r} is not {count} finite numbers; export it again.")
    return values


def _fan(
    words: list[str], points: int, texture: int, where: str, uv_required: bool
) -> Iterator[tuple[int, int]]:
    """Yield (vertex, texture vertex) of the corners of a polygon's triangles."""
    corners = [_corner(word, points, texture, where, uv_required) for word in words]
    if len(corners) < 3:
        raise ValueError(f"{where}: a face of {len(corners)} corners; remove loose edges and export again.")
    for k in range(1, len(corners) - 1):
        yield from (corners[0], corners[k], corners[k + 1])


def _corner(word: str, points: int, texture: int, where: str, uv_required: bool) -> tuple[int, int]:
    parts = word.split("/")
    if len(parts) < 2 or not parts[1]:
        if not uv_required:
            return _vertex(word, points, where), -1
        raise ValueError(f"{where}: corner {word!r} has no texture coordinate; unwrap the garment's UVs.")
    try:
        found = tuple(_index(int(part), size) for part, size in zip(parts, (points, texture), strict=False))
    except ValueError:
        found = (-1, -1)
    if min(found) < 0:
        raise ValueError(
            f"{where}: corner {word!r} names a vertex that is not there ({points} vertices and {texture} "
            "texture coordinates before it); export the mesh again."
        )
    return found[0], found[1]


def _vertex(word: str, points: int, where: str) -> int:
    """Return the vertex of a face's, a line's or a point's corner, whatever follows a slash."""
    try:
        found = _index(int(word.split("/")[0]), points)
    except ValueError:
        found = -1
    if found < 0:
        raise ValueError(
            f"{where}: {word!r} names a vertex that is not there ({points} vertices before it); export the "
            "mesh again."
        )
    return found


def _index(number: int, size: int) -> int:
    """Return the index from 0, -1 when out of range (OBJ counts from 1, or back from the end)."""
    index = number - 1 if number > 0 else size + number
    return index if number != 0 and 0 <= index < size else -1
