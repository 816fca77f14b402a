"""PLY meshes, ASCII and binary, vertex order kept (mesh libraries split vertices at texture seams).

Vertices with x, y, z, texture coordinates per vertex (s t, u v or texture_u texture_v), faces as lists.
"""

import io
from array import array
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from garment_jax.io.formats.limits import LONGEST_NUMBER, check_size
from garment_jax.io.formats.number_arrays import is_index
from garment_jax.io.formats.obj_statements import number_of
from garment_jax.io.formats.polygon_fans import fan_corners

LARGEST = 96 * 2**20  # bytes; a mesh of 100,000 vertices has a few MB
_LONGEST_HEADER = 2**16  # bytes
_LONGEST_LINE = 2**20  # characters: a polygon of 100,000 corners
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
Columns = dict[str, np.ndarray | tuple[np.ndarray, np.ndarray]]  # by property; lists as (counts, items)
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
    file can hold, names vertices that are not there, or has coordinates that are not finite.
    """
    path = Path(path)
    check_size(path, LARGEST, "a PLY file")
    raw = path.read_bytes().removeprefix(b"\xef\xbb\xbf")
    order, elements, body = _header(raw, path)
    del raw
    try:
        columns = _read_ascii(body, elements) if order == "" else _read_binary(body, elements, order)
    except (ValueError, IndexError, OverflowError, TypeError) as error:
        raise ValueError(f"{path} is cut short or damaged after its header; export it again.") from error
    return _mesh(columns, path)


def _header(raw: bytes, path: Path) -> tuple[str, list[_Element], memoryview]:
    """Return the order of bytes, the elements and what follows the header."""
    end = raw.find(b"end_header", 0, _LONGEST_HEADER)
    if not raw.startswith(b"ply") or end < 0:
        raise ValueError(f"{path} is no PLY file: its header is missing or has no end; export it again.")
    order, elements, words = None, [], []
    try:
        for words in (line.split() for line in raw[:end].decode("ascii", "replace").splitlines()[1:]):
            if words[:1] == ["format"]:
                order = _ORDER[words[1]]
            elif words[:1] == ["element"]:
                elements.append(_Element(words[1], _whole(words[2]), []))
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append(_Property(words[4], _TYPES[words[3]], _TYPES[words[2]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append(_Property(words[2], _TYPES[words[1]]))
    except (KeyError, IndexError, ValueError) as error:
        shown = " ".join(words)[:80]
        raise ValueError(f"{path}: the PLY header says {shown!r}; export it again.") from error
    body = memoryview(raw)[_line_end(raw, end) :]
    rows = sum(element.rows for element in elements)
    if order is None or rows > len(body) or any(element.rows < 0 for element in elements):
        raise ValueError(
            f"{path} announces {rows} rows in the {len(body)} bytes after its header; export it again."
        )
    elements = [element for element in elements if element.rows or element.properties]
    if any(len({p.name for p in e.properties}) < len(e.properties) or not e.properties for e in elements):
        raise ValueError(f"{path}: an element has no properties, or one twice; export it again.")
    return order, elements, body


def _whole(word: str) -> int:
    if len(word) > LONGEST_NUMBER:
        raise ValueError
    return int(word)


def _line_end(raw: bytes, end: int) -> int:
    """Return where the line that begins at `end` is over: after LF, CRLF or, where all lines end so, CR."""
    if b"\n" not in raw[:end]:
        return raw.find(b"\r", end) + 1
    return raw.find(b"\n", end) + 1


def _read_ascii(body: memoryview, elements: list[_Element]) -> dict[str, Columns]:
    lines = io.TextIOWrapper(io.BytesIO(body), "ascii", "replace")
    return {element.name: _ascii_element(lines, element) for element in elements}


def _ascii_element(lines: Iterator[str], element: _Element) -> Columns:
    """Return the columns of an element's lines; blank ones do not count."""
    numbers = {p.name: array("d") for p in element.properties}
    counts = {p.name: array("q") for p in element.properties if p.count}
    for _ in range(element.rows):
        line = next((line for line in lines if not line.isspace()), "")
        if len(line) > _LONGEST_LINE:
            raise ValueError("a line is too long")
        words, at = line.split(), 0
        for p in element.properties:
            length = 1
            if p.count:
                length, at = int(number_of(words[at])), at + 1
                counts[p.name].append(length)
            if not 0 <= length <= len(words) - at:
                raise ValueError("a row is cut short")
            numbers[p.name].extend(map(number_of, words[at : at + length]))
            at += length
    flat = {name: _array(values) for name, values in numbers.items()}
    return {name: (_array(counts[name]), x) if name in counts else x for name, x in flat.items()}


def _array(numbers: array) -> np.ndarray:
    return np.array(numbers)


def _read_binary(body: memoryview, elements: list[_Element], order: str) -> dict[str, Columns]:
    found, at = {}, 0
    for element in elements:
        if not any(p.count for p in element.properties):
            row = np.dtype([(p.name, order + p.kind) for p in element.properties])
            table = np.frombuffer(body, row, element.rows, at)
            at += table.nbytes
            found[element.name] = {p.name: table[p.name] for p in element.properties}
        else:
            found[element.name], at = _read_lists(body, element, order, at)
    return found


def _read_lists(body: memoryview, element: _Element, order: str, at: int) -> tuple[Columns, int]:
    """Read rows that hold lists: at once where all rows look like the first, one by one otherwise."""
    if element.rows:
        counts = _first_counts(body, element, order, at)
        pairs = list(zip(element.properties, counts, strict=True))
        size = sum(
            np.dtype(p.kind).itemsize * c + (np.dtype(p.count).itemsize if p.count else 0) for p, c in pairs
        )
        if at + element.rows * size <= len(body):
            row = np.dtype([cell for p, c in pairs for cell in _cells(p, c, order)])
            table = np.frombuffer(body, row, element.rows, at)
            if all((table["#" + p.name] == c).all() for p, c in pairs if p.count):
                return _from_table(table, element), at + table.nbytes
    return _one_by_one(body, element, order, at)


def _cells(p: _Property, count: int, order: str) -> list[tuple]:
    if not p.count:
        return [(p.name, order + p.kind)]
    return [("#" + p.name, order + p.count), (p.name, order + p.kind, (count,))]


def _from_table(table: np.ndarray, element: _Element) -> Columns:
    return {
        p.name: (table["#" + p.name].astype(np.int64), table[p.name].reshape(-1))
        if p.count
        else table[p.name]
        for p in element.properties
    }


def _first_counts(body: memoryview, element: _Element, order: str, at: int) -> list[int]:
    counts = []
    for p in element.properties:
        count, at = _count(body, p, order, at)
        counts.append(count)
        at += count * np.dtype(p.kind).itemsize
    return counts


def _one_by_one(body: memoryview, element: _Element, order: str, at: int) -> tuple[Columns, int]:
    """Read rows of different lengths: what a property's rows hold is put end to end."""
    pieces: dict[str, bytearray] = {p.name: bytearray() for p in element.properties}
    counts = {p.name: array("q") for p in element.properties if p.count}
    kinds = {p.name: np.dtype(order + p.kind) for p in element.properties}
    for _ in range(element.rows):
        for p in element.properties:
            count, at = _count(body, p, order, at)
            if p.count:
                counts[p.name].append(count)
            size = count * kinds[p.name].itemsize
            if at + size > len(body):
                raise ValueError("a row is cut short")
            pieces[p.name] += body[at : at + size]
            at += size
    values = {name: np.frombuffer(piece, kinds[name]) for name, piece in pieces.items()}
    return {name: (_array(counts[name]), x) if name in counts else x for name, x in values.items()}, at


def _count(body: memoryview, p: _Property, order: str, at: int) -> tuple[int, int]:
    if not p.count:
        return 1, at
    length = np.frombuffer(body, order + p.count, 1, at)
    if not 0 <= int(length[0]) <= len(body):
        raise ValueError("a list's length is absurd")
    return int(length[0]), at + length.nbytes


def _mesh(columns: dict[str, Columns], path: Path) -> Mesh:
    points, polygons = columns.get("vertex", {}), columns.get("face", {})
    listed = polygons.get("vertex_indices", polygons.get("vertex_index"))
    if not all(isinstance(points.get(name), np.ndarray) for name in "xyz") or not isinstance(listed, tuple):
        raise ValueError(f"{path} holds no vertices x y z with faces; export the mesh, not a point cloud.")
    vertices = _floats(points, "xyz", path)
    counts, corners = listed
    if not is_index(corners, len(vertices)):  # nor NaN
        raise ValueError(
            f"{path}: a face names a vertex that is not among its {len(vertices)}; export it again."
        )
    faces = corners.astype(np.int32)[fan_corners(counts)]
    for u, v in _UV_NAMES:
        if isinstance(points.get(u), np.ndarray) and isinstance(points.get(v), np.ndarray):
            return Mesh(vertices, faces, _floats(points, (u, v), path), faces)
    return Mesh(vertices, faces, None, None)


def _floats(points: Columns, names: Iterable[str], path: Path) -> np.ndarray:
    """Return columns side by side as float32."""
    with np.errstate(over="ignore"):  # what float32 cannot hold is infinite, and refused
        found = np.stack([points[name] for name in names], axis=1).astype(np.float32)
    bad = ~np.isfinite(found).all(axis=1)
    if bad.any():
        vertex = int(bad.argmax())
        raise ValueError(f"{path}: vertex {vertex} is {found[vertex].tolist()}, not finite; export it again.")
    return found
