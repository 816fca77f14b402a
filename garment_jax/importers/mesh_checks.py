"""Is a triangle mesh fit to be a garment? Connectivity and shape of its faces (host, NumPy)."""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from garment_jax.importers.finding import Finding, rows

_SINE = 1e-6  # of the angle at a corner below which a triangle has no area
_OPPOSITE = -0.9  # cosine between the normals of a face and of a neighbour that it lies on
_SAME_PLACE = 1e-6  # of the mesh's size: two vertices nearer than this are one that was split


class Edges(NamedTuple):
    """A mesh's undirected edges and the half-edges that make them."""

    pairs: np.ndarray  # [e, 2] ascending vertices
    count: np.ndarray  # [e] faces at each
    of_half: np.ndarray  # [3 f] edge of each half-edge (corner k to k + 1 of face i is 3 i + k)
    forward: np.ndarray  # [3 f] bool, the half-edge goes from the smaller vertex to the larger


def mesh_edges(faces: np.ndarray) -> Edges:
    """Return the edges of triangles `[f, 3]`; a face's edge from a vertex to itself is left among them."""
    half = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2).astype(np.int64)
    low, high = half.min(axis=1), half.max(axis=1)
    number = low * (int(half.max(initial=0)) + 1) + high
    _, first, inverse, count = np.unique(number, return_index=True, return_inverse=True, return_counts=True)
    pairs = np.stack([low, high], axis=1)[first]
    return Edges(pairs, count, inverse.reshape(-1), half[:, 0] < half[:, 1])


def neighbours(edges: Edges) -> np.ndarray:
    """Return the faces at each edge that has two of one winding, `[k, 2]`."""
    order = np.argsort(edges.of_half, kind="stable")
    begin = np.searchsorted(edges.of_half[order], np.flatnonzero(edges.count == 2))
    one, other = order[begin], order[np.minimum(begin + 1, len(order) - 1)]
    consistent = edges.forward[one] != edges.forward[other]
    return np.stack([one[consistent] // 3, other[consistent] // 3], axis=1)


def check_mesh(template: np.ndarray, faces: np.ndarray) -> list[Finding]:
    """Return the findings on a mesh: `template` `[n, 3]` in any unit, `faces` `[f, 3]`."""
    edges = mesh_edges(faces)
    return [
        _unused(template, faces),
        _duplicates(faces),
        _without_area(template, faces),
        _non_manifold(edges),
        _winding(edges),
        _folded(template, faces, edges),
        _unsewn(template, edges),
        _components(faces, len(template)),
    ]


def duplicate_faces(faces: np.ndarray) -> np.ndarray:
    """Return which faces `[f]` have the vertices of an earlier one, or a vertex twice."""
    ordered = np.sort(faces, axis=1)
    _, first = np.unique(ordered, axis=0, return_index=True)
    again = np.ones(len(faces), bool)
    again[first] = False
    return again | (ordered[:, 0] == ordered[:, 1]) | (ordered[:, 1] == ordered[:, 2])


def _unused(template: np.ndarray, faces: np.ndarray) -> Finding:
    used = np.zeros(len(template), bool)
    used[faces] = True
    lone = np.flatnonzero(~used)
    if not len(lone):
        return Finding("unused vertices", "ok", "none")
    return Finding(
        "unused vertices",
        "error",
        f"{len(lone)} of {len(template)} vertices belong to no face",
        rows("vertex", lone),
        "no cloth holds them and no UV map shows them: delete loose vertices where the garment and its clips "
        "are made",
    )


def _duplicates(faces: np.ndarray) -> Finding:
    again = np.flatnonzero(duplicate_faces(faces))
    if not len(again):
        return Finding("duplicate faces", "ok", "none")
    return Finding(
        "duplicate faces",
        "error",
        f"{len(again)} of {len(faces)} faces repeat another one or a vertex of their own",
        rows("face", again),
        "they are stiffer than the cloth: leave them out with --drop-duplicates, or merge them where the "
        "garment is made",
    )


def _without_area(template: np.ndarray, faces: np.ndarray) -> Finding:
    a, b, c = template.astype(np.float64)[faces].transpose(1, 0, 2)
    double = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([np.linalg.norm(x, axis=1) for x in (b - a, c - b, a - c)], axis=0)
    flat = (double <= _SINE * longest**2) & ~duplicate_faces(faces)
    if not flat.any():
        return Finding("faces without area", "ok", "none")
    return Finding(
        "faces without area",
        "warning",
        f"{int(flat.sum())} of {len(faces)} faces have no area",
        rows("face", np.flatnonzero(flat)),
        "a simulation refuses them: dissolve degenerate faces where the garment is made",
    )


def _non_manifold(edges: Edges) -> Finding:
    many = edges.count > 2
    if not many.any():
        return Finding("non-manifold edges", "ok", "none")
    return Finding(
        "non-manifold edges",
        "warning",
        f"{int(many.sum())} edges have more than two faces",
        "vertices " + " and ".join(map(str, edges.pairs[many][0].tolist())),
        "they work, but only two of the faces bend: separate the layers where they were sewn together",
    )


def _winding(edges: Edges) -> Finding:
    ahead = np.bincount(edges.of_half, edges.forward, minlength=len(edges.pairs))
    wrong = (edges.count == 2) & (ahead != 1) & (edges.pairs[:, 0] != edges.pairs[:, 1])
    if not wrong.any():
        return Finding("winding", "ok", "one side")
    return Finding(
        "winding",
        "warning",
        f"{int(wrong.sum())} edges have faces that look to opposite sides",
        "vertices " + " and ".join(map(str, edges.pairs[wrong][0].tolist())),
        "normals turn over there: recalculate outside normals where the garment is made",
    )


def folded_faces(points: np.ndarray, faces: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Return which faces `[f]` lie turned over on two or more of their `neighbours` `pairs` `[k, 2]`."""
    a, b, c = (points.astype(np.float64)[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    length = np.sqrt(np.einsum("fx,fx->f", normal, normal))[:, None]
    normal /= np.where(length > 0, length, 1.0)
    turned = pairs[np.einsum("kx,kx->k", normal[pairs[:, 0]], normal[pairs[:, 1]]) < _OPPOSITE]
    return np.bincount(turned.ravel(), minlength=len(faces)) >= 2


def _folded(template: np.ndarray, faces: np.ndarray, edges: Edges) -> Finding:
    folded = np.flatnonzero(folded_faces(template, faces, neighbours(edges)))
    if not len(folded):
        return Finding("folded faces", "ok", "none")
    return Finding(
        "folded faces",
        "warning",
        f"{len(folded)} of {len(faces)} faces of the template are turned over on their neighbours",
        rows("face", folded),
        "smooth the template there, or check the fan of a concave polygon",
    )


def _unsewn(template: np.ndarray, edges: Edges) -> Finding:
    rim = np.unique(edges.pairs[edges.count == 1])
    size = float(np.ptp(template, axis=0).max())
    pairs = KDTree(template[rim]).query_pairs(_SAME_PLACE * size, output_type="ndarray") if len(rim) else []
    if not len(pairs):
        return Finding("split vertices", "ok", "none")
    split = np.unique(np.take(rim, pairs))
    return Finding(
        "split vertices",
        "warning",
        f"{len(split)} boundary vertices lie on one another",
        "vertices " + " and ".join(map(str, rim[pairs[0]].tolist())),
        "the cloth is open at these seams: export without splitting vertices, or weld them before clips are "
        "made",
    )


def _components(faces: np.ndarray, n: int) -> Finding:
    a, b = faces[:, :2].ravel(), faces[:, 1:].ravel()
    label = connected_components(sp.coo_matrix((np.ones(len(a)), (a, b)), (n, n)))[1]
    count = len(np.unique(label[faces[:, 0]]))
    if count == 1:
        return Finding("components", "ok", "1")
    return Finding(
        "components",
        "note",
        f"{count} pieces that are not connected",
        remedy="fine; pin each one that nothing else holds (--pins group:NAME)",
    )
