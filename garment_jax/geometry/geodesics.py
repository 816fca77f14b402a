"""How far a garment's vertices hang from its pins, along the cloth (host)."""

import numpy as np

from garment_jax.geometry.topology import unique_edges
from garment_jax.structs import Garment


def geodesics_to_pins(garment: Garment, pins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return each vertex' shortest way over edges to a pin, metres, and the row of that pin, `[n]` each.

    Inf (and row 0) for a vertex that hangs on none of `pins` `[p]`, of which there is one at least.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    n, edges = len(garment.template), unique_edges(garment.faces)
    ends = garment.template[edges].astype(np.float64)
    length = np.maximum(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1), 1e-12)  # 0 would be no edge at all
    graph = coo_matrix((length, (edges[:, 0], edges[:, 1])), (n, n)).tocsr()
    way, _, source = dijkstra(graph, directed=False, indices=pins, min_only=True, return_predecessors=True)
    row = np.zeros(n, np.int64)
    row[pins] = np.arange(len(pins))
    return way, np.where(source < 0, 0, row[np.maximum(source, 0)])
