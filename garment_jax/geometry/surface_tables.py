"""Static tables of a closed triangle mesh for closest-point queries (host, NumPy, once per body).

The triangles are cut into leaves of 16 that lie together. Only the grouping is static: the boxes around
the leaves follow the posed vertices in every frame.
"""

from typing import NamedTuple

import numpy as np

LEAF = 16  # triangles; a power of two, the slot within a leaf is packed into 4 bits of the search's key
BRANCH = 4  # leaves whose movement is bounded together
FAN = 8  # triangles around a vertex; the few vertices with more are kept apart


class SurfaceTables(NamedTuple):
    """Connectivity and grouping of a closed, outward-oriented triangle mesh (static).

    Its rows are the mesh's triangles in leaf order, `order` says which is which; a short leaf
    repeats its triangles, and the repeated rows are equal in every respect.
    """

    faces: np.ndarray  # [r, 3] int32, r a multiple of LEAF * BRANCH
    corners: np.ndarray  # [l, u] int32 the vertices of each leaf's triangles, once each, padded by repetition
    branches: np.ndarray  # [b, w] int32 the same of each branch
    spread: np.ndarray  # [3, l] int32 three vertices of each leaf that lie apart: its plane, roughly
    branch_spread: np.ndarray  # [3, b] int32 the same of each branch
    order: np.ndarray  # [r] int32 the triangle's number in the mesh as it was given
    once: np.ndarray  # [r] bool, one row of each triangle: where triangles are counted
    border: np.ndarray  # [e] int32 rows with an edge that has no other triangle; with any there is no inside
    corner_of: np.ndarray  # [c] int32 a row that has the vertex as a corner
    across: np.ndarray  # [r, 3] int32 row across edges (0,1), (1,2), (2,0); itself at a border
    fan: np.ndarray  # [c, FAN, 2] int32 next and last vertex of each triangle around a vertex, or itself
    wide: np.ndarray  # [o] int32 vertices with more triangles than FAN
    wide_fan: np.ndarray  # [o, k, 2] int32 as `fan`, for all of theirs
    wide_place: np.ndarray  # [c] int32 place in `wide`, -1 for the others


def make_surface_tables(vertices: np.ndarray, faces: np.ndarray) -> SurfaceTables:
    """Return the tables of the mesh with rest `vertices` `[c, 3]` (metres) and `faces` `[f, 3]`.

    Raises `ValueError` when a face names a vertex that does not exist or there is no face.
    """
    faces = np.asarray(faces, np.int32)
    vertices = np.asarray(vertices, np.float64)
    if not len(faces):
        raise ValueError("the collider has 0 faces; give a closed triangle mesh or no collider at all.")
    if faces.min() < 0 or faces.max() >= len(vertices):
        worst = faces.min() if faces.min() < 0 else faces.max()
        raise ValueError(f"a collider face names vertex {worst} of {len(vertices)}; give its own indices.")
    order = _leaf_order(vertices[faces].mean(axis=1))
    row = np.empty(len(faces), np.int32)
    row[order[::-1]] = np.arange(len(order), dtype=np.int32)[::-1]  # the first of equal rows
    once = row[order] == np.arange(len(order))
    across = row[_across(faces)][order]
    border = np.flatnonzero((across == np.arange(len(order))[:, None]).any(axis=1)).astype(np.int32)
    rows = faces[order]
    corner_of = np.zeros(len(vertices), np.int32)
    corner_of[rows] = np.arange(len(rows), dtype=np.int32)[:, None]
    corners, branches = (_once_each(rows.reshape(-1, k)) for k in (3 * LEAF, 3 * LEAF * BRANCH))
    spread, branch_spread = (_spread(vertices[x], x) for x in (corners, branches))
    fans = _fans(faces, len(vertices))
    return SurfaceTables(
        rows, corners, branches, spread, branch_spread, order, once, border, corner_of, across, *fans
    )


def point_groups(points: np.ndarray, size: int = 8) -> np.ndarray:
    """Return `[g, size]` int32 groups of `points` `[n, 3]` that lie together, padded by repetition.

    Made once from a garment's template. The middle one comes first: it speaks for its group.
    """
    points = np.asarray(points, np.float64)
    groups = []
    for members in _bisect(points, size):
        apart = ((points[members] - points[members].mean(axis=0)) ** 2).sum(axis=1)
        groups.append(members[np.argsort(apart, kind="stable")])
    return _pad_rows(groups, size)


def _bisect(points: np.ndarray, size: int) -> list[np.ndarray]:
    """Return index sets of at most `size` points, halving along the longest axis."""
    done, todo = [], [np.arange(len(points))]
    while todo:
        members = todo.pop()
        if len(members) <= size:
            done.append(members)
            continue
        axis = np.ptp(points[members], axis=0).argmax()
        members = members[np.argsort(points[members, axis], kind="stable")]
        half = -(-len(members) // size) // 2 * size
        todo += [members[half:], members[:half]]
    return done


def _pad_rows(rows: list[np.ndarray], size: int) -> np.ndarray:
    return np.stack([np.resize(row, size) for row in rows]).astype(np.int32)


def _once_each(rows: np.ndarray) -> np.ndarray:
    """Return the different numbers of each row; a third of a mesh's corners, so a third of the gathers."""
    unique = [np.unique(row) for row in rows]
    return _pad_rows(unique, max(map(len, unique)))


def _spread(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the vertex farthest from the middle, the farthest from that, the farthest from their line."""
    leaf = np.arange(len(points))
    first = ((points - points.mean(axis=1, keepdims=True)) ** 2).sum(axis=-1).argmax(axis=1)
    away = points - points[leaf, first][:, None]
    second = (away**2).sum(axis=-1).argmax(axis=1)
    third = (np.cross(away, away[leaf, second][:, None]) ** 2).sum(axis=-1).argmax(axis=1)
    return np.stack([corners[leaf, k] for k in (first, second, third)])


def _leaf_order(centres: np.ndarray) -> np.ndarray:
    """Return triangle numbers `[r]`, leaf after leaf, BRANCH leaves in a row lying together."""
    branches = []
    for members in _bisect(centres, LEAF * BRANCH):
        rows = _pad_rows([members[row] for row in _bisect(centres[members], LEAF)], LEAF)
        branches.append(rows[np.minimum(np.arange(BRANCH), len(rows) - 1)])
    return np.concatenate(branches).reshape(-1)


def _across(faces: np.ndarray) -> np.ndarray:
    """Return the triangle across each edge; a border edge, or one of three triangles, gets itself."""
    f = len(faces)
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    _, code, count = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(code, kind="stable")
    owner = np.repeat(np.arange(f, dtype=np.int32), 3)
    first = np.cumsum(count) - count
    total = owner[order[first]] + owner[order[first + np.minimum(count, 2) - 1]]
    across = np.where(count[code] == 2, total[code] - owner, owner)
    return across.reshape(f, 3).astype(np.int32)


def _fans(faces: np.ndarray, c: int):
    """Return `fan`, `wide`, `wide_fan` and `wide_place` of `SurfaceTables`.

    A cap's centre may have a hundred triangles; padding all to that would cost every vertex.
    """
    vertex = faces.reshape(-1)
    ahead = np.stack([np.roll(faces, -1, axis=1), np.roll(faces, 1, axis=1)], axis=-1).reshape(-1, 2)
    order = np.argsort(vertex, kind="stable")
    vertex, ahead = vertex[order], ahead[order]
    valence = np.bincount(vertex, minlength=c)
    slot = np.arange(len(vertex)) - np.repeat(np.cumsum(valence) - valence, valence)
    whole = (
        np.arange(c, dtype=np.int32)[:, None, None].repeat(max(valence.max(), FAN), axis=1).repeat(2, axis=2)
    )
    whole[vertex, slot] = ahead
    wide = np.flatnonzero(valence > FAN).astype(np.int32)
    place = np.full(c, -1, np.int32)
    place[wide] = np.arange(len(wide))
    return whole[:, :FAN].copy(), wide, whole[wide], place
