"""Values at some vertices spread over a mesh: displacements that fade with distance, weights made smooth."""

import numpy as np
import scipy.sparse as sparse
import scipy.sparse.linalg as solvers

from garment_jax.geometry.topology import unique_edges

_DIFFUSION_STEPS = 8
_VALENCE = 6.0  # of a regular triangle mesh, in which the graph Laplacian is -valence / 4 h^2 times Lap


def smooth_extension(rest: np.ndarray, faces: np.ndarray, known: np.ndarray, *, reach: float) -> np.ndarray:
    """Return `H` `[n, k]` float32: `H @ d` extends displacements `d` `[k, 3]` of the vertices `known`.

    Solves d - reach^2 Lap d = 0 (screened Laplace equation, uniform weights) with d given at `known` `[k]`;
    free at boundaries. A displacement fades by a factor e every `reach` metres of cloth; parts that hang on
    none of the known vertices stay. Rows of `H` are not negative and sum to at most 1.
    """
    n = len(rest)
    graph, lengths = _graph_laplacian(rest, faces)
    screen = _VALENCE / 4.0 * (float(lengths.mean()) / reach) ** 2
    system = (graph + screen * sparse.eye(n)).tocsr()
    free = np.setdiff1d(np.arange(n), known)
    H = np.zeros((n, len(known)), np.float32)
    H[known] = np.eye(len(known), dtype=np.float32)
    if len(free) and len(known):
        solve = solvers.factorized(system[free][:, free].tocsc())
        right = -system[free][:, known].toarray()
        H[free] = np.stack([solve(column) for column in right.T], axis=1)
    return np.clip(H, 0.0, 1.0)


def diffused(x: np.ndarray, rest: np.ndarray, faces: np.ndarray, *, reach: float) -> np.ndarray:
    """Return values `x` `[n, k]` at vertices, averaged over about `reach` metres of cloth; float64.

    The heat equation by implicit Euler, uniform weights, free at boundaries: a value moves by `reach` in the
    root mean square. Convex combinations: rows that sum to 1 still do, and nothing turns negative.
    """
    graph, lengths = _graph_laplacian(rest, faces)
    pace = reach**2 / float(np.square(lengths).mean()) / _VALENCE / _DIFFUSION_STEPS
    solve = solvers.factorized((pace * graph + sparse.eye(len(rest))).tocsc())
    y = np.asarray(x, np.float64)
    for _ in range(_DIFFUSION_STEPS):
        y = np.stack([solve(column) for column in y.T], axis=1)
    return y


def _graph_laplacian(rest: np.ndarray, faces: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray]:
    """Return degrees less adjacency `[n, n]`, and the edges' lengths `[e]` in metres."""
    n, edges = len(rest), unique_edges(faces)
    length = np.linalg.norm(rest[edges[:, 0]] - rest[edges[:, 1]], axis=1)
    adjacency = sparse.coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), (n, n))
    adjacency = (adjacency + adjacency.T).tocsr()
    degree = np.asarray(adjacency.sum(axis=1)).ravel()
    return (sparse.diags(degree) - adjacency).tocsr(), length
