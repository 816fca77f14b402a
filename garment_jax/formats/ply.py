"""PLY meshes, ASCII and binary, vertex order kept (mesh libraries split vertices at texture seams).

Vertices with x, y, z, texture coordinates per vertex (s t, u v or texture_u texture_v), faces as lists.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.formats.mesh_cache import fan_corners

LARGEST = 512 * 2**20  # bytes; a mesh of 100,000 vertices has a few MB
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))


class Mesh(NamedTuple):
    """One mesh as a file has it: its own unit and axes."""

    vertices: np.ndarray  # [n, 3] float32
    faces: np.ndarray  # [f, 3] int32, polygons as fans
    uv: np.ndarray | None  # [u, 2] float32
    faces_uv: np.ndarray | None  # [f, 3] int32 indices into uv


class _Property(NamedTuple):
    name: str
    kind: str  # NumPy's type of the value, or of a list's items
    count: str = ""  # NumPy's type of a list's length, "" for a single value


class _Element(NamedTuple):
    name: str
    rows: int
    properties: list[_Property]


def read_ply(path: str | Path) -> Mesh:
    """Read a PLY mesh.

    Raises `FileNotFoundError`, or `ValueError` for what is no PLY, is cut short, announces more than the
    file can hold, or names vertices that are not there.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path} is not there; name a PLY file.")
    if path.stat().st_size > LARGEST:
        raise ValueError(f"{path} has {path.stat().st_size / 2**20:.0f} MB; no garment needs that, check it.")
    raw = path.read_bytes()
    order, elements, body = _header(raw, path)
    try:
        columns = _read_ascii(body, elements) if order == "" else _read_binary(body, elements, order)
    except (ValueError, IndexError, OverflowError) as error:
        raise ValueError(f"{path} is cut short or damaged after its header; export it again.") from error
    return _mesh(columns, path)


def _header(raw: bytes, path: Path) -> tuple[str, list[_Element], bytes]:
    end = raw.find(b"end_header")
    lines = raw[: max(end, 0)].decode("ascii", "replace").split("\n")
    if not raw.startswith(b"ply") or end < 0:
        raise ValueError(f"{path} is no PLY file: its header is missing or has no end; export it again.")
    order, elements = None, []
    try:
        for words in (line.split() for line in lines[1:]):
            if words[:1] == ["format"]:
                order = _ORDER[words[1]]
            elif words[:1] == ["element"]:
                elements.append(_Element(words[1], int(words[2]), []))
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append(_Property(words[4], _TYPES[words[3]], _TYPES[words[2]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append(_Property(words[2], _TYPES[words[1]]))
    except (KeyError, IndexError, ValueError) as error:
        raise ValueError(f"{path}: the PLY header says {' '.join(words)!r}; export it again.") from error
    body = raw[raw.find(b"\n", end) + 1 :]
    rows = sum(element.rows for element in elements)
    if order is None or rows > len(body) or any(element.rows < 0 for element in elements):
        raise ValueError(
            f"{path} announces {rows} rows in the {len(body)} bytes after its header; export it again."
        )
    return order, elements, body


def _read_ascii(body: bytes, elements: list[_Element]) -> dict[str, dict[str, Any]]:
    lines = [line for line in body.split(b"\n") if line.strip()]
    found, at = {}, 0
    for element in elements:
        rows = [[float(word) for word in line.split()] for line in lines[at : at + element.rows]]
        if len(rows) < element.rows:
            raise ValueError("too few lines")
        at += element.rows
        found[element.name] = _columns(rows, element)
    return found


def _columns(rows: list[list[float]], element: _Element) -> dict[str, Any]:
    """Return an element's values by property: arrays, lists as (counts, items)."""
    if not any(p.count for p in element.properties):
        table = np.array(rows, np.float64).reshape(len(rows), len(element.properties))
        return {p.name: table[:, k] for k, p in enumerate(element.properties)}
    at, columns = [0] * len(rows), {}
    for p in element.properties:
        counts = [int(row[k]) if p.count else 1 for row, k in zip(rows, at, strict=True)]
        first = [k + bool(p.count) for k in at]
        items = [row[k : k + c] for row, k, c in zip(rows, first, counts, strict=True)]
        if any(len(item) != c for item, c in zip(items, counts, strict=True)):
            raise ValueError("a list is cut short")
        at = [k + c for k, c in zip(first, counts, strict=True)]
        flat = np.array([x for item in items for x in item], np.float64)
        columns[p.name] = (np.array(counts, np.int64), flat) if p.count else flat
    return columns


def _read_binary(body: bytes, elements: list[_Element], order: str) -> dict[str, dict[str, Any]]:
    found, at = {}, 0
    for element in elements:
        if not any(p.count for p in element.properties):
            row = np.dtype([(p.name, order + p.kind) for p in element.properties])
            table = np.frombuffer(body, row, element.rows, at)
            at += table.nbytes
            found[element.name] = {p.name: table[p.name].astype(np.float64) for p in element.properties}
        else:
            found[element.name], at = _read_lists(body, element, order, at)
    return found


def _read_lists(body: bytes, element: _Element, order: str, at: int) -> tuple[dict[str, Any], int]:
    """Read rows that hold lists: at once where all rows look like the first, one by one otherwise."""
    if element.rows:
        counts = _first_counts(body, element, order, at)
        row = np.dtype(
            [x for p, c in zip(element.properties, counts, strict=True) for x in _cells(p, c, order)]
        )
        if at + element.rows * row.itemsize <= len(body):
            table = np.frombuffer(body, row, element.rows, at)
            lists = [(p, c) for p, c in zip(element.properties, counts, strict=True) if p.count]
            if all((table["#" + p.name] == c).all() for p, c in lists):
                return _from_table(table, element), at + table.nbytes
    rows = []
    for _ in range(element.rows):
        row, at = _one_row(body, element, order, at)
        rows.append(row)
    return _columns(rows, element), at


def _cells(p: _Property, count: int, order: str) -> list[tuple]:
    if not p.count:
        return [(p.name, order + p.kind)]
    return [("#" + p.name, order + p.count), (p.name, order + p.kind, (count,))]


def _from_table(table: np.ndarray, element: _Element) -> dict[str, Any]:
    values = {p.name: table[p.name].astype(np.float64).reshape(-1) for p in element.properties}
    return {
        p.name: (table["#" + p.name].astype(np.int64), values[p.name]) if p.count else values[p.name]
        for p in element.properties
    }


def _first_counts(body: bytes, element: _Element, order: str, at: int) -> list[int]:
    counts = []
    for p in element.properties:
        count, at = _count(body, p, order, at)
        counts.append(count)
        at += count * np.dtype(p.kind).itemsize
    return counts


def _one_row(body: bytes, element: _Element, order: str, at: int) -> tuple[list[float], int]:
    row: list[float] = []
    for p in element.properties:
        count, at = _count(body, p, order, at)
        row += [count] if p.count else []
        items = np.frombuffer(body, order + p.kind, count, at)
        row += items.tolist()
        at += items.nbytes
    return row, at


def _count(body: bytes, p: _Property, order: str, at: int) -> tuple[int, int]:
    if not p.count:
        return 1, at
    length = np.frombuffer(body, order + p.count, 1, at)
    if not 0 <= int(length[0]) <= len(body):
        raise ValueError("a list's length is absurd")
    return int(length[0]), at + length.nbytes


def _mesh(columns: dict[str, dict[str, Any]], path: Path) -> Mesh:
    points, polygons = columns.get("vertex", {}), columns.get("face", {})
    listed = polygons.get("vertex_indices", polygons.get("vertex_index"))
    if not all(name in points for name in "xyz") or not isinstance(listed, tuple):
        raise ValueError(f"{path} holds no vertices x y z with faces; export the mesh, not a point cloud.")
    vertices = np.stack([points[name] for name in "xyz"], axis=1).astype(np.float32)
    counts, corners = listed
    if len(corners) and not (corners.min() >= 0 and corners.max() < len(vertices)):  # nor NaN
        raise ValueError(f"{path}: a face names a vertex that is not among its {len(vertices)}.")
    faces = corners.astype(np.int32)[fan_corners(counts)]
    for u, v in _UV_NAMES:
        if u in points and v in points:
            return Mesh(vertices, faces, np.stack([points[u], points[v]], axis=1).astype(np.float32), faces)
    return Mesh(vertices, faces, None, None)
