"""Half a mesh: evened out on its implicit surface, cut into triangles, closed by its mirror image."""

import numpy as np
from scipy.sparse import csr_matrix

from garment_jax.procedural.slivers import smallest_angles
from garment_jax.procedural.surface_nets import Field

STEP = 1e-4  # metres, of the difference quotient
FLIP = np.array([-1.0, 1.0, 1.0])


def partners(vertices: np.ndarray) -> np.ndarray:
    """Return the number `[n]` that each vertex' mirror image gets in `mirrored`: x = 0 keeps its own."""
    twin = np.arange(len(vertices))
    off = np.flatnonzero(vertices[:, 0] != 0)
    twin[off] = len(vertices) + np.arange(len(off))
    return twin


def mirrored(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the half mesh joined with its mirror image in x; vertices with x = 0 are shared."""
    twin = partners(vertices)
    whole = np.concatenate([vertices, vertices[vertices[:, 0] != 0] * FLIP])
    return whole, np.concatenate([faces, twin[faces][:, ::-1]])


def relax(vertices: np.ndarray, faces: np.ndarray, field: Field, *, rounds: int) -> np.ndarray:
    """Return the half's vertices `[n, 3]` moved along the surface towards the mean of their neighbours.

    After each round they are put back on {field = 0}, those of the border on x = 0. `faces` may be
    quads or triangles.
    """
    n, border, mean = len(vertices), vertices[:, 0] == 0, _neighbour_mean(vertices, faces)
    V = vertices
    normal = _value_and_normal(V, field)[1]
    for _ in range(rounds):
        pull = (mean @ np.concatenate([V, V[~border] * FLIP]))[:n] - V
        V = V + 0.6 * (pull - (pull * normal).sum(axis=1, keepdims=True) * normal)
        distance, normal = _value_and_normal(V, field)
        V = V - np.clip(distance, -0.01, 0.01)[:, None] * normal
        V[border, 0] = 0.0
    return V


def triangulated(vertices: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Return triangles `[2 f, 3]`: every quad cut so that its smallest angle is as large as can be.

    Where two quads have a diagonal in common, the second takes its other one: an edge has two sides.
    """
    a, b, c, d = quads.T
    one, other = np.stack([[a, b, c], [a, c, d]]), np.stack([[a, b, d], [b, c, d]])  # [2, 3, f]
    first = _smallest_angle(vertices, one) >= _smallest_angle(vertices, other)
    diagonal = np.sort(np.where(first, [a, c], [b, d]), axis=0)
    repeated = np.ones(len(quads), bool)
    repeated[np.unique(diagonal, axis=1, return_index=True)[1]] = False
    return np.where(first ^ repeated, one, other).transpose(0, 2, 1).reshape(-1, 3)


def _smallest_angle(vertices: np.ndarray, corners: np.ndarray) -> np.ndarray:
    both = [smallest_angles(vertices, half.T) for half in corners]
    return np.minimum(*both)


def _neighbour_mean(vertices: np.ndarray, faces: np.ndarray) -> csr_matrix:
    whole, all_faces = mirrored(vertices, faces)
    a, b = all_faces.reshape(-1), np.roll(all_faces, -1, axis=1).reshape(-1)
    n = len(whole)
    graph = csr_matrix((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a])), shape=(n, n))
    graph.data[:] = 1.0
    return csr_matrix(graph.multiply(1.0 / np.asarray(graph.sum(axis=1))))


def _value_and_normal(V: np.ndarray, field: Field) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance to the surface to first order `[n]` and the unit gradient `[n, 3]`."""
    value = field(V)
    ahead = field((V[None] + STEP * np.eye(3)[:, None]).reshape(-1, 3)).reshape(3, -1)
    gradient = (ahead - value).T / STEP
    length = np.maximum(np.linalg.norm(gradient, axis=1), 0.1)
    return value / length, gradient / length[:, None]
