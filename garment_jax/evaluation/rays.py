"""How often a closed surface goes around many points: crossings of a ray each (host, NumPy, float64).

A ray leaves a closed surface once more than it enters it for every time that the surface goes around where
it begins. Exact, in a twentieth of the time of the sum of all solid angles (`geometry/winding_number.py`).
The sign of an edge is the same, digit for digit, for both of its triangles, so that a ray through an edge or
a corner crosses one of them.
"""

from typing import NamedTuple

import numpy as np

LEAF = 8  # triangles in a box
BLOCK = 5000  # points at a time: a byte for each of them and each box
_GRID = 1024  # cells a side that triangles are sorted by


class RayBoxes(NamedTuple):
    """A frame's triangles in boxes of some that lie together."""

    corners: np.ndarray  # [l, LEAF, 3, 3] float64 metres
    once: np.ndarray  # [l, LEAF] bool; the last box repeats its last triangle
    low: np.ndarray  # [l, 3]
    high: np.ndarray  # [l, 3]


def ray_boxes(corners: np.ndarray) -> RayBoxes:
    """Prepare the triangles `[f, 3, 3]` (metres) of a closed surface."""
    middle = corners.mean(axis=1)
    cell = (middle - middle.min(axis=0)) * ((_GRID - 1) / max(float(np.ptp(middle, axis=0).max()), 1e-12))
    order = np.argsort(_interleaved(cell.astype(np.uint64)), kind="stable")
    places = np.arange(len(order) + -len(order) % LEAF).reshape(-1, LEAF)
    boxed = corners[order[np.minimum(places, len(order) - 1)]]
    return RayBoxes(boxed, places < len(order), boxed.min(axis=(1, 2)), boxed.max(axis=(1, 2)))


def winding_by_ray(points: np.ndarray, boxes: RayBoxes) -> np.ndarray:
    """Return the winding number `[q]` int of the surface around `points` `[q, 3]`; rays go along +z."""
    number = np.zeros(len(points), int)
    possible = ((points >= boxes.low.min(axis=0)) & (points <= boxes.high.max(axis=0))).all(axis=1)
    for start in range(0, len(points), BLOCK):
        some = start + np.flatnonzero(possible[start : start + BLOCK])
        number[some] = _around(points[some].astype(np.float64), boxes)
    return number


def _around(p: np.ndarray, boxes: RayBoxes) -> np.ndarray:
    met = p[:, None, 2] <= boxes.high[None, :, 2]
    for x in range(2):
        met &= (p[:, None, x] >= boxes.low[None, :, x]) & (p[:, None, x] <= boxes.high[None, :, x])
    which, box = np.nonzero(met)
    count = _crossings(p[which], boxes.corners[box], boxes.once[box])
    return np.rint(np.bincount(which, count, minlength=len(p))).astype(int)


def _crossings(p: np.ndarray, corners: np.ndarray, once: np.ndarray) -> np.ndarray:
    """Return how many of its `corners` `[k, LEAF, 3, 3]` each ray leaves through, less those it enters by."""
    x, y, z = (corners[..., axis] - p[:, None, None, axis] for axis in range(3))
    ahead, area = np.empty(x.shape, bool), np.empty(x.shape)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        area[..., i] = x[..., j] * y[..., k] - y[..., j] * x[..., k]
        # of an edge through the ray one of the two triangles has it, by the order of its ends
        first = (x[..., j] < x[..., k]) | ((x[..., j] == x[..., k]) & (y[..., j] < y[..., k]))
        ahead[..., i] = (area[..., i] > 0) | ((area[..., i] == 0) & first)
    volume = (z * area).sum(axis=-1)
    leaves = ahead.all(axis=-1) & (volume > 0) & once
    enters = ~ahead.any(axis=-1) & (volume < 0) & once
    return leaves.sum(axis=-1) - enters.sum(axis=-1)


def _interleaved(cell: np.ndarray) -> np.ndarray:
    """Return the bits of three coordinates `[f, 3]` below 1024 in turn: what is near has near numbers."""
    code = np.zeros(len(cell), np.uint64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cell[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return code
