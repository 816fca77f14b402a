"""Displacements of some vertices carried over to the rest of a mesh: smooth, and fading with distance."""

import numpy as np
import scipy.sparse as sparse
import scipy.sparse.linalg as solvers

from garment_jax.geometry.topology import unique_edges

_VALENCE = 6.0  # of a regular triangle mesh, in which the graph Laplacian is -valence / 4 h^2 times Lap


def smooth_extension(rest: np.ndarray, faces: np.ndarray, known: np.ndarray, *, reach: float) -> np.ndarray:
    """Return `H` `[n, k]` float32: `H @ d` extends displacements `d` `[k, 3]` of the vertices `known`.

    Solves d - reach^2 Lap d = 0 (screened Laplace equation, uniform weights) with d given at `known` `[k]`;
    free at boundaries. A displacement fades by a factor e every `reach` metres of cloth; parts that hang on
    none of the known vertices stay. Rows of `H` are not negative and sum to at most 1.
    """
    n, edges = len(rest), unique_edges(faces)
    length = np.linalg.norm(rest[edges[:, 0]] - rest[edges[:, 1]], axis=1)
    ones = np.ones(len(edges))
    adjacency = sparse.coo_matrix((ones, (edges[:, 0], edges[:, 1])), (n, n))
    adjacency = (adjacency + adjacency.T).tocsr()
    degree = np.asarray(adjacency.sum(axis=1)).ravel()
    screen = _VALENCE / 4.0 * (float(length.mean()) / reach) ** 2
    system = (sparse.diags(degree + screen) - adjacency).tocsr()
    free = np.setdiff1d(np.arange(n), known)
    H = np.zeros((n, len(known)), np.float32)
    H[known] = np.eye(len(known), dtype=np.float32)
    if len(free) and len(known):
        solve = solvers.factorized(system[free][:, free].tocsc())
        right = -system[free][:, known].toarray()
        H[free] = np.stack([solve(column) for column in right.T], axis=1)
    return np.clip(H, 0.0, 1.0)
