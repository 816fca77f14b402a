"""Rows of curves around the body as a triangulated garment: closed with a UV seam at the back, or open.

Rows have as many vertices as their length asks for, so edges are even from a narrow waist to a wide
hem. Everything is made for one half and mirrored: the garment is exactly symmetric in x.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from garment_jax.structs import Garment

PSI = np.linspace(
    0.0, np.pi, 721
)  # where a row's curve is sampled: from the back to the front (see `contour`)


class Row(NamedTuple):
    """One row of a garment, from the top."""

    path: np.ndarray  # [721, 3] metres, the body's right half from its back on; starts on x = 0
    v: float  # 1 at the top to 0 at the hem


class Tube(NamedTuple):
    """A garment and where its texture vertices came from."""

    garment: Garment
    counts: np.ndarray  # [r] vertices of each row; vertices are stored row by row
    psi: np.ndarray  # [u] each texture vertex' place in PSI, mirrored: 0 … 2 pi, or -pi … pi when open
    fraction: np.ndarray  # [u] its part of its row's length, 0 … 1
    row: np.ndarray  # [u]


def make_tube(rows: list[Row], edge: float, *, closed: bool = True) -> Tube:
    """Return the garment through `rows` with edges of about `edge` metres.

    Closed: paths end on x = 0 at the front, u runs around from the back seam, whose vertices have two
    UVs. Open: the paths' ends are the borders and the back is the middle, u = 0.5.
    """
    counts = np.array([row_count(row, edge, closed) for row in rows])
    steps = counts // 2
    lengths = [_length(row) for row in rows]
    middle = lengths[len(rows) // 2]
    points, columns = [], []
    for row, length, k in zip(rows, lengths, steps, strict=True):
        psi = np.interp(np.linspace(0.0, length[-1], k + 1), length, PSI)
        half = np.stack([np.interp(psi, PSI, row.path[:, x]) for x in range(3)], axis=1)
        half[[0, -1] if closed else [0], 0] = 0.0
        u = np.interp(psi, PSI, middle / middle[-1])
        table = np.stack([u, np.linspace(0.0, 1.0, k + 1), psi / np.pi], axis=1) / 2
        points.append(_both(half, closed)[0])
        columns.append(_both(table, closed)[1])
    faces_uv = _faces_uv(points, steps, closed)
    table, texture = np.concatenate(columns), np.array([len(c) for c in columns])
    row_of = np.repeat(np.arange(len(rows)), texture)
    place = np.arange(len(table)) - np.repeat(np.cumsum(texture) - texture, texture)
    owner = (np.cumsum(counts) - counts)[row_of] + place % counts[row_of]
    uv = np.stack([table[:, 0], np.array([row.v for row in rows])[row_of]], axis=1)
    garment = Garment(
        np.concatenate(points).astype(np.float32),
        owner[faces_uv].astype(np.int32),
        uv.astype(np.float32),
        faces_uv.astype(np.int32),
    )
    return Tube(garment, counts, 2 * np.pi * table[:, 2], table[:, 1], row_of)


def row_count(row: Row, edge: float, closed: bool) -> int:
    """Return how many vertices divide the whole row into edges of about `edge`; the same on both sides."""
    steps = max(round(_length(row)[-1] / edge), 3)
    return 2 * steps if closed else 2 * steps + 1


def fitting_edge(rows_at: Callable[[float], list[Row]], vertices: int, *, closed: bool = True) -> float:
    """Return the edge length, metres, at which the rows `rows_at(edge)` hold about `vertices`."""
    low, high, tried = 0.003, 0.2, {}
    for _ in range(18):
        edge = float(np.sqrt(low * high))
        count = sum(row_count(row, edge, closed) for row in rows_at(edge))
        tried[abs(count - vertices)] = edge
        low, high = (edge, high) if count > vertices else (low, edge)
    return tried[min(tried)]


def _length(row: Row) -> np.ndarray:
    """Return the length of the row's path up to each of its samples, metres."""
    return np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(row.path, axis=0), axis=1))]


def _both(half: np.ndarray, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return a half row's points, and its table of halved u, part and angle, for both sides."""
    if not closed:
        return np.concatenate([half[:0:-1] * [-1, 1, 1], half]), np.concatenate(
            [[0.5, 0.5, 0.0] - half[:0:-1], [0.5, 0.5, 0.0] + half]
        )
    return np.concatenate([half, half[-2:0:-1] * [-1, 1, 1]]), np.concatenate([half, 1.0 - half[-2::-1]])


def _faces_uv(points: list[np.ndarray], steps: np.ndarray, closed: bool) -> np.ndarray:
    """Return all triangles `[f, 3]` in texture vertices, of which a row of k steps to a side has 2 k + 1."""
    start, faces = 0, []
    for k in range(len(steps) - 1):
        n = steps[k : k + 2]
        back = np.zeros(2, int) if closed else n
        halves = [points[k + i][back[i] : back[i] + n[i] + 1] for i in range(2)]
        right = _zipped(*halves)  # rows: which of the two, place
        which, place = right[..., 0], right[..., 1]
        offset = np.array([start, start + 2 * n[0] + 1])[which]
        other = (2 * n[which] if closed else 2 * back[which]) - (back[which] + place)
        faces += [offset + back[which] + place, (offset + other)[:, ::-1]]
        start += 2 * n[0] + 1
    return np.concatenate(faces)


def _zipped(top: np.ndarray, low: np.ndarray) -> np.ndarray:
    """Return triangles `[f, 3, 2]` between two polylines, always the shorter next diagonal."""
    i = j = 0
    out = []
    while i < len(top) - 1 or j < len(low) - 1:
        right = np.linalg.norm(top[i + 1] - low[j]) if i < len(top) - 1 else np.inf
        down = np.linalg.norm(top[i] - low[j + 1]) if j < len(low) - 1 else np.inf
        if right < down:
            out.append([(0, i), (1, j), (0, i + 1)])
            i += 1
        else:
            out.append([(0, i), (1, j), (1, j + 1)])
            j += 1
    return np.array(out)
