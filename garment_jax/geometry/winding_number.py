"""How often a closed surface goes around a point (host, NumPy, float64)."""

import numpy as np

_PAIRS = 60_000  # of a point and a triangle at a time: their numbers stay in the cache


def winding_number(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the winding number `[q]` of the triangle mesh around `points` `[q, 3]`.

    0 outside, 1 inside, 2 where two parts of the surface cover each other, -1 inside a part that is
    turned inside out; a fraction near the holes of an open mesh. The sum of the triangles' solid angles
    over 4 pi (van Oosterom and Strackee 1983), every triangle for every point: meant for few points. On
    the surface itself it lies between the values of both sides.
    """
    corners = vertices.astype(np.float64)[faces]
    rows = max(1, _PAIRS // max(len(faces), 1))
    parts = [_around(points[i : i + rows].astype(np.float64), corners) for i in range(0, len(points), rows)]
    return np.concatenate(parts) if parts else np.zeros(0)


def _around(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    # coordinates apart: products of whole arrays take a third of the time of einsum and cross on short axes
    a, b, c = ([corners[:, k, x] - points[:, x, None] for x in range(3)] for k in range(3))
    la, lb, lc = (np.sqrt(_dot(x, x)) for x in (a, b, c))
    across = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]]
    # arctan2(0, 0) is 0: a triangle without area, or one that has the point as a corner, has no say
    beside = la * lb * lc + _dot(a, b) * lc + _dot(b, c) * la + _dot(c, a) * lb
    volume = _dot(a, across) + 0.0  # no -0: arctan2 would take a point on an edge to the other side
    return np.arctan2(volume, beside).sum(axis=1) / (2 * np.pi)


def _dot(u: list[np.ndarray], v: list[np.ndarray]) -> np.ndarray:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
