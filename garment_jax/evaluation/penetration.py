"""How far a garment is inside the body: exact signed distance to a closed surface.

Where it crosses itself, to that of the union of its parts: inside is what it goes around once or more.
"""

from typing import NamedTuple

import numpy as np

from garment_jax.evaluation.rays import RayBoxes, ray_boxes, winding_by_ray
from garment_jax.evaluation.surface import Surface, SurfacePoint, closest_point, make_surface
from garment_jax.evaluation.triangles import FACE, closest_on_triangle, cross, dot
from garment_jax.evaluation.union_surface import union_distance
from garment_jax.geometry.winding_number import winding_number

TOLERANCE_MM = 0.1  # a vertex counts as inside below minus this
ON_SURFACE = 1e-9  # metres: nearer to a sheet its side is the sheet's
ROOM_MM = 1.0  # that a vertex needs outside the body: cloth is about as thick


class ClosedSurface(NamedTuple):
    """A closed surface of one frame, prepared for signed distances."""

    surface: Surface
    vertices: np.ndarray  # [n, 3] float64 metres
    faces: np.ndarray  # [f, 3] int, outward
    flat: np.ndarray  # [f, 3] unit normals of the faces; 0 for a face without area
    at_vertex: np.ndarray  # [n, 3] angle-weighted sums of them, not normalised
    neighbours: np.ndarray  # [f, 3] int, see `neighbour_faces`
    boxes: RayBoxes


class Penetration(NamedTuple):
    """One frame's penetration."""

    inside_percent: float  # per cent of vertices with signed distance below -TOLERANCE_MM
    deepest_mm: float  # depth of the deepest vertex, mm; 0 when none is inside


def neighbour_faces(faces: np.ndarray) -> np.ndarray:
    """Return `[f, 3]`: the face on the other side of each edge (corner i to i + 1) of `faces`.

    Raises `ValueError` when an edge has not exactly two faces of opposite direction: an open or
    ill-oriented surface has no inside.
    """
    n = int(faces.max()) + 1
    a, b = faces.astype(np.int64), np.roll(faces, -1, axis=1).astype(np.int64)
    ahead, back = (a * n + b).ravel(), (b * n + a).ravel()
    order = np.argsort(ahead)
    at = np.searchsorted(ahead[order], back)
    twin = order[np.minimum(at, len(order) - 1)]
    open_edges = int((ahead[twin] != back).sum() + len(ahead) - len(np.unique(ahead)))
    if open_edges:
        raise ValueError(
            f"the collider has {open_edges} edges without exactly two faces of opposite direction; "
            "close its holes (a cap) and orient its faces outward."
        )
    return (twin // 3).reshape(-1, 3)


def closed_surface(vertices: np.ndarray, faces: np.ndarray, neighbours: np.ndarray) -> ClosedSurface:
    """Prepare a closed surface `[n, 3]` (metres), `[f, 3]`; `neighbours` as from `neighbour_faces`."""
    vertices = vertices.astype(np.float64)
    corners = vertices[faces]
    flat = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(flat, axis=-1, keepdims=True)
    flat = flat / np.where(length > 0, length, 1.0)  # a face without area has no say: zero
    at_vertex = _vertex_normals(corners, flat, faces, len(vertices))
    surface = make_surface(vertices, faces)
    return ClosedSurface(surface, vertices, faces, flat, at_vertex, neighbours, ray_boxes(surface.corners))


def signed_distance(points: np.ndarray, closed: ClosedSurface) -> np.ndarray:
    """Return the exact signed distance `[q]` of `points` `[q, 3]` to a closed surface, metres.

    Positive outside, where its winding number is 0 or less (so in a part that is turned inside out), negative
    where it is 1 or more. The distance is that to the surface between the two: where parts cross each other,
    to the surface of their union.
    """
    points = points.astype(np.float64)
    hit = closest_point(points, closed.surface)
    behind = dot(points - hit.point, _pseudo_normal(hit, closed)) < 0
    number = winding_by_ray(points, closed.boxes)
    distance = hit.distance.copy()
    # No sheet lies between a point and its nearest sheet, whose outer side so has the number 0 if it bounds
    # the union. On the surface itself a number is either side's.
    other = np.flatnonzero((number != behind) & (distance > ON_SURFACE))
    for i in other:
        distance[i] = _to_union(points[i], closed)
    touching = distance <= ON_SURFACE
    return np.where(np.where(touching, behind, number >= 1), -distance, distance)


def _to_union(point: np.ndarray, closed: ClosedSurface) -> float:
    corners = closed.surface.corners
    near = closest_on_triangle(np.broadcast_to(point, (len(corners), 3)), corners)
    hit = SurfacePoint(near.distance, near.point, np.arange(len(corners)), near.feature)
    outward = _pseudo_normal(hit, closed)
    return union_distance(point, near.point, outward, corners, closed.flat, closed.boxes)


def pinched(points: np.ndarray, closed: ClosedSurface) -> np.ndarray:
    """Return which of `points` `[q, 3]`, all inside, lie where the closed surface crosses itself, `[q]`.

    Two parts of a body that cover each other, as thighs do in a split, leave a vertex between them no way
    out: pushed out of the one it is in the other. So either the surface goes around the point more than
    once (winding number 1.5 or more), or `ROOM_MM` outside its nearest surface it is inside again (0.5 or
    more).
    """
    points = points.astype(np.float64)
    hit = closest_point(points, closed.surface)
    normal = _pseudo_normal(hit, closed)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    way_out = hit.point + ROOM_MM / 1000.0 * normal / np.where(length > 0, length, 1.0)
    covered_twice = winding_number(points, closed.vertices, closed.faces) >= 1.5
    return covered_twice | (winding_number(way_out, closed.vertices, closed.faces) >= 0.5)


def _pseudo_normal(hit: SurfacePoint, closed: ClosedSurface) -> np.ndarray:
    normal = closed.flat[hit.face].copy()
    edge = (hit.feature >= 3) & (hit.feature < FACE)
    normal[edge] += closed.flat[closed.neighbours[hit.face[edge], hit.feature[edge] - 3]]
    corner = hit.feature < 3
    normal[corner] = closed.at_vertex[closed.faces[hit.face[corner], hit.feature[corner]]]
    return normal


def _vertex_normals(corners: np.ndarray, flat: np.ndarray, faces: np.ndarray, n: int) -> np.ndarray:
    """Return the angle-weighted sums of face normals `[n, 3]`, not normalised (only signs matter)."""
    total = np.zeros((n, 3))
    for i in range(3):
        u = corners[:, (i + 1) % 3] - corners[:, i]
        v = corners[:, (i + 2) % 3] - corners[:, i]
        angle = np.arctan2(np.linalg.norm(cross(u, v), axis=-1), dot(u, v))
        for axis in range(3):
            total[:, axis] += np.bincount(faces[:, i], angle * flat[:, axis], minlength=n)
    return total


def is_inside(distance: np.ndarray) -> np.ndarray:
    """Return which signed distances (metres) count as inside."""
    return distance < -TOLERANCE_MM / 1000.0


def penetration(distance: np.ndarray) -> Penetration:
    """Return one frame's penetration from its signed distances `[n]` (metres, positive outside)."""
    inside = is_inside(distance)
    deepest = max(0.0, -1000.0 * float(distance.min(initial=0.0)))
    return Penetration(100.0 * float(inside.mean()), deepest)
