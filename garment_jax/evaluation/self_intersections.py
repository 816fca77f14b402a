"""Edges of a garment that cross a triangle of the same garment (method, "Metrics")."""

import numpy as np
from scipy.spatial import KDTree

from garment_jax.evaluation.triangles import crosses
from garment_jax.geometry.topology import unique_edges


def self_intersections(V: np.ndarray, faces: np.ndarray, edges: np.ndarray | None = None) -> int:
    """Return how many edges of one frame `V` `[n, 3]` cross a triangle they share no vertex with.

    A crossing is proper: the edge's ends lie strictly on both sides of the triangle's plane and the
    edge's line passes strictly through it; touching does not count. `edges` `[e, 2]` may be passed
    to spare computing them for every frame.
    """
    edges = unique_edges(faces) if edges is None else edges
    V = V.astype(np.float64)
    V = V - V.mean(axis=0)
    edge, face = _candidates(V, faces, edges)
    crossing = crosses(V[edges[edge]], V[faces[face]])
    return len(np.unique(edge[crossing]))


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
