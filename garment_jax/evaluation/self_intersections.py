"""Where a garment goes through itself: edges through triangles, and the cloth behind them."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from garment_jax.evaluation.triangles import cross, crosses
from garment_jax.geometry.topology import unique_edges


class SelfIntersections(NamedTuple):
    """Where one frame goes through itself."""

    edges: int  # that cross a triangle they share no vertex with
    vertices: np.ndarray  # [n] bool, ends of these edges and corners of these triangles
    area_cm2: float  # of cloth on the other side: what these edges cut off from the rest of its piece


def self_intersections(
    V: np.ndarray, faces: np.ndarray, edges: np.ndarray | None = None
) -> SelfIntersections:
    """Return where one frame `V` `[n, 3]` (metres) goes through itself.

    A crossing is proper: the edge's ends lie strictly on both sides of the triangle's plane and the
    edge's line passes strictly through it; touching does not count. An edge that crosses an odd number of
    triangles leads to the other side; cloth that is joined to the larger part of its piece by no other edge
    is on the other side (Baraff, Witkin and Kass 2003, "Untangling cloth", flood fill). `edges` `[e, 2]` may
    be passed to spare computing them for every frame.
    """
    edges = unique_edges(faces) if edges is None else edges
    V = V.astype(np.float64)
    V = V - V.mean(axis=0)
    edge, face = _candidates(V, faces, edges)
    crossing = crosses(V[edges[edge]], V[faces[face]])
    edge, face = edge[crossing], face[crossing]
    vertices = np.zeros(len(V), bool)
    vertices[edges[edge]] = vertices[faces[face]] = True
    count = np.bincount(edge, minlength=len(edges))
    area = _other_side(V, faces, edges, count % 2 == 1) if len(edge) else 0.0
    return SelfIntersections(int((count > 0).sum()), vertices, 1e4 * area)


def _other_side(V: np.ndarray, faces: np.ndarray, edges: np.ndarray, cut: np.ndarray) -> float:
    """Return the area (m²) of what `cut` edges `[e]` part from the largest rest of each piece of cloth."""
    corners = V[faces]
    doubled = np.linalg.norm(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    own = np.bincount(faces.ravel(), np.repeat(doubled / 6, 3), len(V))
    _, piece = _parts(edges, len(V))
    parts, part = _parts(edges[~cut], len(V))
    area, of = np.bincount(part, own, parts), np.zeros(parts, int)
    of[part] = piece
    order = np.lexsort((-area, of))
    _, largest = np.unique(of[order], return_index=True)
    return float(np.delete(area, order[largest]).sum())


def _parts(edges: np.ndarray, n: int) -> tuple[int, np.ndarray]:
    joined = coo_matrix((np.ones(len(edges), np.int8), (edges[:, 0], edges[:, 1])), (n, n))
    return connected_components(joined, directed=False)


def _candidates(V: np.ndarray, faces: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (edge, face) pairs whose boxes overlap and that share no vertex.

    Broad phase: an edge that meets a triangle has its midpoint within (half its length + the
    largest corner distance) of the triangle's centre.
    """
    ends, corners = V[edges], V[faces]
    middle, centre = ends.mean(axis=1), corners.mean(axis=1)
    reach = np.linalg.norm(ends[:, 0] - middle, axis=1)
    reach += np.linalg.norm(corners - centre[:, None], axis=-1).max()
    found = KDTree(centre).query_ball_point(middle, reach * (1 + 1e-9), return_sorted=False)
    edge = np.repeat(np.arange(len(edges)), np.fromiter(map(len, found), np.int64, len(edges)))
    face = np.concatenate([np.asarray(f, np.int64) for f in found])
    low, high = ends.min(axis=1), ends.max(axis=1)
    bottom, top = corners.min(axis=1), corners.max(axis=1)
    for axis in range(3):  # one axis at a time: each leaves less for the next
        keep = (low[edge, axis] <= top[face, axis]) & (bottom[face, axis] <= high[edge, axis])
        edge, face = edge[keep], face[keep]
    apart = (edges[edge][:, :, None] != faces[face][:, None, :]).all(axis=(1, 2))
    return edge[apart], face[apart]
