"""Distance to the surface of the union of a body's parts (host, NumPy, float64): exact where they cross, too.

Of the skin of a posed body what lies within another part bounds nothing. The union's surface is what has a
winding number of 1 or more on one side and of 0 or less on the other. Its point nearest to a vertex is the
closest point of a triangle, or lies on the line along which two triangles cross, or in a point where three
do: those candidates are tried, nearest first, until one has both kinds of sides.
"""

from itertools import product

import numpy as np

from garment_jax.evaluation.rays import RayBoxes, winding_by_ray
from garment_jax.evaluation.triangles import cross, dot

BESIDE = 1e-7  # metres from a candidate at which its sides are looked at
BLOCK = 64  # candidates whose sides are looked at together


def union_distance(
    point: np.ndarray,
    nearest: np.ndarray,
    outward: np.ndarray,
    corners: np.ndarray,
    flat: np.ndarray,
    boxes: RayBoxes,
) -> float:
    """Return the distance of one `point` `[3]` to the union's surface, metres; infinite if there is none.

    Of each triangle (`corners` `[f, 3, 3]`) of a closed surface: the `nearest` point to it `[f, 3]`, the
    direction `outward` there `[f, 3]`, its unit normal `flat` `[f, 3]`. `boxes`: the same for rays.
    """
    best = _nearest_bounding(point, nearest, _unit(outward)[:, None], boxes, np.inf)
    local = np.flatnonzero(np.linalg.norm(nearest - point, axis=1) < best)
    segments, normals = _crossings(corners[local], flat[local])
    if not len(segments):
        return best
    best = _nearest_bounding(point, _on_segments(point, segments), normals, boxes, best)
    meeting, three = _meetings(segments, normals, corners[local], flat[local])
    return _nearest_bounding(point, meeting, three, boxes, best)


def _nearest_bounding(
    point: np.ndarray, candidates: np.ndarray, normals: np.ndarray, boxes: RayBoxes, best: float
) -> float:
    """Return the distance of the nearest candidate `[k, 3]` that bounds the union, at most `best`.

    `normals` `[k, m, 3]`: of the m sheets that meet there.
    """
    distance = np.linalg.norm(candidates - point, axis=1)
    order = np.argsort(distance)
    order = order[distance[order] < best]
    signs = np.array(list(product((1.0, -1.0), repeat=normals.shape[1])))
    for start in range(0, len(order), BLOCK):
        some = order[start : start + BLOCK]
        beside = candidates[some, None] + BESIDE * np.einsum("sm,kmx->ksx", signs, normals[some])
        inside = winding_by_ray(beside.reshape(-1, 3), boxes).reshape(len(some), -1) >= 1
        bounds = inside.any(axis=1) & ~inside.all(axis=1)
        if bounds.any():
            return float(distance[some[bounds.argmax()]])
    return best


def _crossings(corners: np.ndarray, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the segments `[k, 2, 3]` along which pairs of triangles cross, and both normals `[k, 2, 3]`."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    a, b = np.nonzero(np.triu((low[:, None] <= high[None]).all(-1) & (high[:, None] >= low[None]).all(-1), 1))
    ends = np.concatenate([_edge_meets(corners[a], corners[b]), _edge_meets(corners[b], corners[a])], axis=1)
    found = np.isfinite(ends[..., 0])
    pair = np.flatnonzero(found.sum(axis=1) >= 2)
    if not len(pair):
        return np.zeros((0, 2, 3)), np.zeros((0, 2, 3))
    picked = ends[pair[:, None], np.argsort(~found[pair], axis=1, kind="stable")[:, :2]]
    return picked, np.stack([flat[a[pair]], flat[b[pair]]], axis=1)


def _edge_meets(corners: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return where the three edges of each triangle pass through its other, `[k, 3, 3]`; NaN where not."""
    return np.stack(
        [_through(corners[:, i], corners[:, (i + 1) % 3], others) for i in range(3)], axis=1
    ).reshape(-1, 3, 3)


def _through(p: np.ndarray, q: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return where segments p to q pass properly through triangles, `[k, 3]`; NaN where they do not."""
    a, normal = corners[:, 0], cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    above, below = dot(p - a, normal), dot(q - a, normal)
    apart = above - below
    at = p + (above / np.where(apart == 0, 1.0, apart))[:, None] * (q - p)
    proper = above * below < 0
    for i in range(3):
        start, end = corners[:, i], corners[:, (i + 1) % 3]
        proper &= dot(cross(end - start, at - start), normal) >= 0
    return np.where(proper[:, None], at, np.nan)


def _on_segments(point: np.ndarray, segments: np.ndarray) -> np.ndarray:
    start, way = segments[:, 0], segments[:, 1] - segments[:, 0]
    length = dot(way, way)
    along = np.clip(dot(point - start, way) / np.where(length > 0, length, 1.0), 0.0, 1.0)
    return start + along[:, None] * way


def _meetings(segments, normals, corners, flat) -> tuple[np.ndarray, np.ndarray]:
    """Return where a third triangle cuts the segments, `[k, 3]`, and the three normals there `[k, 3, 3]`."""
    line, other = (x.ravel() for x in np.indices((len(segments), len(corners))))
    at = _through(segments[line, 0], segments[line, 1], corners[other])
    met = np.isfinite(at[:, 0])
    three = np.concatenate([normals[line[met]], flat[other[met], None]], axis=1)
    return at[met], three


def _unit(u: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(u, axis=-1, keepdims=True)
    return u / np.where(length > 0, length, 1.0)
