"""Exact distance from points to a triangle surface (host, NumPy and SciPy's k-d tree, float64).

Which triangles can hold the closest point is decided by a proof, not by a number of neighbours.
For a point q of a triangle with corners v_i and barycentric weights w_i, and any p,

    sum_i w_i |p - v_i|^2 = |p - q|^2 + sum_i w_i |q - v_i|^2 <= |p - q|^2 + r^2,

where r is the radius of the smallest sphere around the triangle. So a triangle that comes within d
of p has a corner within sqrt(d^2 + r^2) of p. With d the distance already found, that shell holds a
handful of corners however far away p is. Triangles are sorted into classes by the power of two of
r, so that one big triangle (a cap) does not widen the search among the small ones.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from garment_jax.evaluation.triangles import closest_on_triangle, cross, dot

NEAREST = 8  # corners that a query looks at before it asks for all within reach
BLOCK = 128  # points that `farthest` asks about at a time


class SizeClass(NamedTuple):
    """The triangles of similar size, with a tree over their corners."""

    tree: KDTree  # over the corners below
    radius: float  # largest enclosing radius in the class, metres
    start: np.ndarray  # [k + 1] int, corner i's faces are face[start[i]:start[i + 1]]
    face: np.ndarray  # [3 g] int


class Surface(NamedTuple):
    """A triangle surface of one frame, prepared for queries."""

    corners: np.ndarray  # [f, 3, 3] metres
    radius: np.ndarray  # [f] metres, of the smallest sphere around each triangle
    classes: tuple[SizeClass, ...]  # ascending size


class SurfacePoint(NamedTuple):
    """The surface's closest point to each query."""

    distance: np.ndarray  # [q] metres, >= 0
    point: np.ndarray  # [q, 3]
    face: np.ndarray  # [q] int
    feature: np.ndarray  # [q] int, see triangles.FACE


def enclosing_radius(corners: np.ndarray) -> np.ndarray:
    """Return the radius `[f]` of the smallest sphere around triangles `[f, 3, 3]`.

    Acute: the circumradius. Obtuse, right or without area: half the longest edge.
    """
    edges = corners - np.roll(corners, 1, axis=1)
    square = np.sort(dot(edges, edges), axis=1)
    area2 = np.linalg.norm(cross(edges[:, 0], edges[:, 1]), axis=-1)
    acute = (square[:, 0] + square[:, 1] > square[:, 2]) & (area2 > 0)
    around = np.sqrt(square.prod(axis=1)) / (2 * np.where(acute, area2, 1.0))
    return np.where(acute, around, np.sqrt(square[:, 2]) / 2)


def make_surface(vertices: np.ndarray, faces: np.ndarray) -> Surface:
    """Prepare the surface of `vertices` `[n, 3]` (metres) and `faces` `[f, 3]` for queries."""
    corners = vertices.astype(np.float64)[faces]
    radius = enclosing_radius(corners)
    usual = max(float(np.median(radius)), 1e-12)
    size = np.ceil(np.log2(np.maximum(radius / (2 * usual), 1.0))).astype(int)
    classes = tuple(_size_class(vertices, faces, np.flatnonzero(size == s), radius) for s in np.unique(size))
    return Surface(corners, radius, classes)


def _size_class(vertices: np.ndarray, faces: np.ndarray, chosen: np.ndarray, radius: np.ndarray) -> SizeClass:
    used, corner = np.unique(faces[chosen].ravel(), return_inverse=True)
    order = np.argsort(corner.ravel(), kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(corner.ravel(), minlength=len(used)))])
    tree = KDTree(vertices[used].astype(np.float64))
    return SizeClass(tree, float(radius[chosen].max()), start, chosen[order // 3])


def closest_point(points: np.ndarray, surface: Surface) -> SurfacePoint:
    """Return the exact closest point of `surface` to every one of `points` `[q, 3]` (metres)."""
    points = points.astype(np.float64)
    best = SurfacePoint(
        np.full(len(points), np.inf),
        np.zeros_like(points),
        np.zeros(len(points), np.int64),
        np.zeros(len(points), np.int8),
    )
    found = [_nearest_corners(points, group) for group in surface.classes]
    nearest = np.argmin([distance[:, 0] for distance, _ in found], axis=0)
    for i, group in enumerate(surface.classes):
        chosen = np.flatnonzero(nearest == i)
        _improve(best, points, surface, *_faces_of(group, chosen, found[i][1][chosen, 0]))
    for group, (distance, corner) in zip(surface.classes, found, strict=True):
        query, corner = _within_reach(points, best.distance, group, distance, corner)
        if not len(query):
            continue
        query, face = _faces_of(group, query, corner)
        _improve(best, points, surface, *_still_possible(query, face, points, surface, best))
    return best


def farthest(points: np.ndarray, surface: Surface, *, at_least: float = 0.0) -> float:
    """Return the largest distance of `points` `[q, 3]` to `surface`, metres, or `at_least` if that is more.

    The nearest corner bounds each distance from above; exact distances are asked for in descending order of
    these bounds until none left can be the largest.
    """
    points = points.astype(np.float64)
    bound = np.stack([group.tree.query(points)[0] for group in surface.classes]).min(axis=0)
    order, largest, start = np.argsort(-bound), at_least, 0
    while start < len(order) and bound[order[start]] > largest:
        asked = order[start : start + BLOCK]
        asked = asked[bound[asked] > largest]
        largest = max(largest, float(closest_point(points[asked], surface).distance.max()))
        start += BLOCK
    return largest


def _nearest_corners(points: np.ndarray, group: SizeClass) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances `[q, k]` of the nearest corners, ascending, and these corners."""
    distance, corner = group.tree.query(points, k=np.arange(1, min(NEAREST, group.tree.n) + 1))
    return distance, corner


def _within_reach(
    points: np.ndarray, best: np.ndarray, group: SizeClass, distance: np.ndarray, corner: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the (query, corner) pairs whose triangles may come within the distances `best` `[q]`.

    For most queries they are among the nearest ones, which a tree finds faster than all in a ball.
    """
    reach = np.sqrt(best**2 + group.radius**2) * (1 + 1e-9)
    near = distance <= reach[:, None]
    many = near[:, -1] & (distance.shape[1] < group.tree.n)
    query, place = np.nonzero(near & ~many[:, None])
    ball = np.flatnonzero(many)
    if not len(ball):
        return query, corner[query, place]
    found = group.tree.query_ball_point(points[ball], reach[ball], return_sorted=False)
    count = np.fromiter(map(len, found), np.int64, len(found))
    corners = np.concatenate([np.asarray(f, np.int64) for f in found])
    return np.concatenate([query, np.repeat(ball, count)]), np.concatenate([corner[query, place], corners])


def _faces_of(group: SizeClass, query: np.ndarray, corner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the (query, face) pairs around (query, corner) pairs."""
    count = group.start[corner + 1] - group.start[corner]
    first = np.repeat(group.start[corner] - (np.cumsum(count) - count), count)
    return np.repeat(query, count), group.face[first + np.arange(count.sum())]


def _still_possible(
    query: np.ndarray, face: np.ndarray, points: np.ndarray, surface: Surface, best: SurfacePoint
) -> tuple[np.ndarray, np.ndarray]:
    """Drop repeated pairs and faces whose own sphere already proves them too far."""
    count = len(surface.corners)
    key = np.sort(query * count + face)
    key = key[np.concatenate([[True], key[1:] != key[:-1]])]
    query, face = key // count, key % count
    offset = surface.corners[face] - points[query, None]
    nearest = dot(offset, offset).min(axis=-1)
    keep = nearest <= (best.distance[query] ** 2 + surface.radius[face] ** 2) * (1 + 1e-9)
    return query[keep], face[keep]


def _improve(
    best: SurfacePoint, points: np.ndarray, surface: Surface, query: np.ndarray, face: np.ndarray
) -> None:
    """Replace entries of `best` in place by closer ones among the (query, face) pairs, which may be none."""
    if not len(query):
        return
    tried = closest_on_triangle(points[query], surface.corners[face])
    order = np.lexsort((tried.distance, query))
    first = np.concatenate([[True], query[order][1:] != query[order][:-1]])
    pick = order[first]
    pick = pick[tried.distance[pick] < best.distance[query[pick]]]
    at = query[pick]
    best.distance[at], best.point[at] = tried.distance[pick], tried.point[pick]
    best.face[at], best.feature[at] = face[pick], tried.feature[pick]
