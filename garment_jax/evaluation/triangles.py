"""Closest points on single triangles and segments through them, exact and batched (host, NumPy, float64).

Kept apart from the collision solver's traced closest point on purpose: a metric that shared its
code could not find its faults.
"""

from typing import NamedTuple

import numpy as np

FACE = 6  # features: 0-2 the triangle's corners, 3-5 its edges (corner i to i + 1), 6 its inside


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the dot products `[...]` of `[..., 3]`; four times as fast as a sum over so short an axis."""
    return np.einsum("...i,...i->...", a, b)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross products `[..., 3]`."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return out


class TrianglePoint(NamedTuple):
    """The closest point of each triangle to its query."""

    point: np.ndarray  # [q, 3] metres
    distance: np.ndarray  # [q] metres
    feature: np.ndarray  # [q] int, where on the triangle it lies (see FACE)


def closest_on_triangle(points: np.ndarray, corners: np.ndarray) -> TrianglePoint:
    """Return the closest point of triangle i to point i; `points` `[q, 3]`, `corners` `[q, 3, 3]`.

    The three edges are tried as segments and the plane's foot where it falls inside, so a triangle
    without area (a segment or a point) is handled exactly and needs no tolerance.
    """
    best, square, feature = _on_edges(points, corners)
    foot, inside = _plane_foot(points, corners)
    foot_square = np.where(inside, dot(points - foot, points - foot), np.inf)
    on_face = foot_square < square
    best[on_face] = foot[on_face]
    feature[on_face] = FACE
    return TrianglePoint(best, np.sqrt(np.where(on_face, foot_square, square)), feature)


def _on_edges(points: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    best, square = np.empty_like(points), np.full(len(points), np.inf)
    feature = np.zeros(len(points), np.int8)
    for i in range(3):
        j = (i + 1) % 3
        a, edge = corners[:, i], corners[:, j] - corners[:, i]
        length = dot(edge, edge)
        s = dot(points - a, edge) / np.where(length > 0, length, 1.0)
        s = np.clip(s, 0.0, 1.0)
        at = a + s[:, None] * edge
        d = dot(points - at, points - at)
        closer = d < square
        best[closer], square[closer] = at[closer], d[closer]
        where = np.where(s <= 0.0, i, np.where(s >= 1.0, j, 3 + i))
        feature[closer] = where[closer]
    return best, square, feature


def _plane_foot(points: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the foot on each triangle's plane and whether it lies strictly inside."""
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    w, normal = points - a, cross(u, v)
    square = dot(normal, normal)
    safe = np.where(square > 0, square, 1.0)
    beta = dot(cross(w, v), normal) / safe
    gamma = dot(cross(u, w), normal) / safe
    inside = (square > 0) & (beta > 0) & (gamma > 0) & (beta + gamma < 1)
    height = dot(w, normal) / safe
    return points - height[:, None] * normal, inside


def crosses(ends: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return whether segment i properly crosses triangle i; `[k, 2, 3]`, `[k, 3, 3]`."""
    p, q = ends[:, 0], ends[:, 1]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    both_sides = _volume(a, b, c, p) * _volume(a, b, c, q) < 0
    u, v, w = _volume(p, q, a, b), _volume(p, q, b, c), _volume(p, q, c, a)
    through = ((u > 0) & (v > 0) & (w > 0)) | ((u < 0) & (v < 0) & (w < 0))
    return both_sides & through


def _volume(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return six times the signed volume `[k]` of tetrahedra."""
    return dot(cross(b - a, c - a), d - a)
