"""Wavefront OBJ both ways, vertex order kept: positions, triangles and, where there are some, UVs.

Unlike a garment's template (`data/obj.py`), a frame of an animation may have no texture coordinates.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from garment_jax.formats.mesh_cache import fan_corners
from garment_jax.formats.ply import LARGEST, Mesh

HEAD = "# garment_jax\n"  # how a file begins that is written here


def read_obj(path: str | Path) -> Mesh:
    """Read an OBJ mesh, polygons as fans; the file's own unit and axes.

    Raises `FileNotFoundError`, or `ValueError` for numbers that are none, faces that name vertices that are
    not there, or a file that holds no vertices.
    """
    positions, texture, faces = split_lines(path)
    vertices = numbers(positions, 3, path)
    counts, corners = _corners(faces, len(vertices), len(texture), path)
    fans = fan_corners(counts)
    if not len(texture) or (corners[:, 1] < 0).any():
        return Mesh(vertices, corners[fans, 0], None, None)
    return Mesh(vertices, corners[fans, 0], numbers(texture, 2, path), corners[fans, 1])


def split_lines(path: str | Path) -> tuple[list[bytes], list[bytes], list[bytes]]:
    """Return an OBJ's lines of positions, texture coordinates and faces, without their keyword."""
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path} is not there; name an OBJ file.")
    if path.stat().st_size > LARGEST:
        raise ValueError(f"{path} has {path.stat().st_size / 2**20:.0f} MB; no garment needs that, check it.")
    found: dict[bytes, list[bytes]] = {b"v": [], b"vt": [], b"f": []}
    for line in path.read_bytes().replace(b"\\\n", b" ").split(b"\n"):
        keyword, _, rest = line.strip().replace(b"\t", b" ").partition(b" ")
        if keyword == b"f" and b"-" in rest:
            rest = _absolute(rest, len(found[b"v"]), len(found[b"vt"]))
        if keyword in found:
            found[keyword].append(rest)
    if not found[b"v"]:
        raise ValueError(f"{path} holds no vertices; it is no OBJ mesh, or it is empty.")
    return found[b"v"], found[b"vt"], found[b"f"]


def _absolute(face: bytes, points: int, texture: int) -> bytes:
    """Return a face's corners counted from 1 where they count back from its line (-1 is the last one)."""
    sizes = (points, texture)

    def absolute(part: bytes, size: int) -> bytes:
        return b"%d" % (size + 1 + int(part)) if re.fullmatch(rb"-\d{1,18}", part) else part

    corners = (word.split(b"/")[:2] for word in face.split())
    return b" ".join(b"/".join(map(absolute, corner, sizes)) for corner in corners)


def numbers(lines: list[bytes], count: int, path: str | Path) -> np.ndarray:
    """Return the first `count` finite numbers of every line, `[len(lines), count]` float32."""
    try:
        values = np.array([line.split()[:count] for line in lines]).astype(np.float64)
        wrong = values.shape != (len(lines), count) or not np.isfinite(values).all()
    except ValueError:
        wrong, values = True, np.zeros(0)
    if wrong:
        bad = next((line for line in lines if not _finite(line.split()[:count], count)), b"")
        text = bad.decode("utf-8", "replace")
        raise ValueError(f"{path}: {text!r} is not {count} finite numbers; export it again.")
    return values.astype(np.float32)


def _finite(words: list[bytes], count: int) -> bool:
    try:
        return len(words) == count and bool(np.isfinite([float(word) for word in words]).all())
    except ValueError:
        return False


def _corners(
    faces: list[bytes], points: int, texture: int, path: str | Path
) -> tuple[np.ndarray, np.ndarray]:
    """Return corners a face `[p]` and, of all corners, (vertex, texture vertex or -1) `[c, 2]` int32."""
    counts, corners = np.zeros(len(faces), np.int64), []
    for k, face in enumerate(faces):
        words = face.split()
        counts[k] = len(words)
        for word in words:
            parts = word.split(b"/")
            second = parts[1] if len(parts) > 1 else b""
            try:
                corner = _index(int(parts[0]), points), _index(int(second), texture) if second else -2
            except ValueError:
                corner = (-1, -1)
            if -1 in corner:
                raise ValueError(
                    f"{path}: corner {word.decode('utf-8', 'replace')!r} names a vertex that is not among "
                    f"the {points} vertices and {texture} texture coordinates; export the mesh again."
                )
            corners.append(corner)
    return counts, np.array(corners, np.int32).reshape(-1, 2)


def _index(number: int, size: int) -> int:
    """Return the index from 0, -1 when out of range (OBJ counts from 1)."""
    return number - 1 if 1 <= number <= size else -1


def obj_faces(faces: np.ndarray, uv: np.ndarray | None = None, faces_uv: np.ndarray | None = None) -> str:
    """Return the lines of an OBJ that stay from frame to frame: texture coordinates and triangles."""
    corners = np.asarray(faces) + 1
    if uv is None or faces_uv is None:
        return ("f %d %d %d\n" * len(corners)) % tuple(corners.ravel().tolist())
    both = np.stack([corners, np.asarray(faces_uv) + 1], axis=2)
    text = ("vt %.9g %.9g\n" * len(uv)) % tuple(np.asarray(uv, np.float64).ravel().tolist())
    return text + ("f %d/%d %d/%d %d/%d\n" * len(both)) % tuple(both.ravel().tolist())


def write_obj(path: str | Path, vertices: np.ndarray, tail: str, notes: Sequence[str] = ()) -> None:
    """Write comments, `vertices` `[n, 3]` in their order with nine digits (float32 exactly), then `tail`."""
    text = HEAD + "".join(f"# {note}\n" for note in notes)
    text += ("v %.9g %.9g %.9g\n" * len(vertices)) % tuple(np.asarray(vertices, np.float64).ravel().tolist())
    Path(path).write_text(text + tail, encoding="utf-8")


def is_our_obj(path: Path) -> bool:
    """Return whether `write_obj` wrote a file."""
    with path.open("rb") as file:
        return file.read(len(HEAD)) == HEAD.encode()


def notes_of(path: Path) -> list[str]:
    """Return the notes that `write_obj` was given; none where there is no file of its."""
    if not path.is_file() or not is_our_obj(path):
        return []
    notes = []
    with path.open(encoding="utf-8") as file:
        next(file)
        for line in file:
            if not line.startswith("# "):
                break
            notes.append(line[2:].rstrip("\n"))
    return notes
