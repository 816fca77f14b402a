"""How often a closed surface goes around a point (host, NumPy, float64)."""

import numpy as np

_PAIRS = 1_000_000  # of a point and a triangle in memory at a time; each takes about 200 bytes


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
    a, b, c = (corners[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.sqrt(np.einsum("qfx,qfx->qf", x, x)) for x in (a, b, c))
    volume = np.einsum("qfx,qfx->qf", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("qfx,qfx->qf", x, y) for x, y in ((a, b), (b, c), (c, a)))
    # arctan2(0, 0) is 0: a triangle without area, or one that has the point as a corner, has no say
    angle = 2 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
    return angle.sum(axis=1) / (4 * np.pi)
