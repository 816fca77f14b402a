"""Edges through faces as the toolkit of Incremental Potential Contact counts them."""

import ipctk
import numpy as np


def crossing_edges(V: np.ndarray, edges: np.ndarray, faces: np.ndarray) -> int:
    """Return how many `edges` [e, 2] go through one of the `faces` [f, 3] that they share no vertex with."""
    tree, x = ipctk.HashGrid(), V.astype(np.float64)
    tree.build(x, edges, faces, 1e-6)
    pairs = [(pair.edge_id, pair.face_id) for pair in tree.detect_edge_face_candidates()]
    found = {
        edge
        for edge, face in pairs
        if not {*edges[edge].tolist()} & {*faces[face].tolist()}
        and ipctk.is_edge_intersecting_triangle(*x[edges[edge]], *x[faces[face]])
    }
    return len(found)
