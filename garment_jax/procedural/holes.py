"""Cutting vertices off a closed mesh and closing the holes with triangles between their own vertices."""

import numpy as np


def closed(faces: np.ndarray, keep: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the kept vertices `[c]` and the faces between them, `[d, 3]` in their numbering, closed.

    `faces` `[f, 3]` of a closed mesh, `keep` `[n]` bool. Dropped too are vertices where two parts of the
    border would touch and those of a single triangle, whose far edge a lid could repeat. A hole is
    closed by a strip to and fro between its two sides.
    """
    keep = keep.copy()
    while True:
        inner = faces[keep[faces].all(axis=1)]
        border = _border(inner)
        around = np.bincount(inner.ravel(), minlength=len(keep))
        touching = np.bincount(border[:, 0], minlength=len(keep)) > 1
        still = (around > 1) & ~touching
        if (still == keep).all():
            break
        keep = still
    kept = np.flatnonzero(keep)
    lids = [_lid(loop) for loop in _loops(border)]
    return kept, np.searchsorted(kept, np.concatenate([inner, *lids]))


def _border(faces: np.ndarray) -> np.ndarray:
    """Return the directed edges `[k, 2]` that have no counterpart."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    n = int(pairs.max()) + 1
    return pairs[~np.isin(pairs[:, 0] * n + pairs[:, 1], pairs[:, 1] * n + pairs[:, 0])]


def _loops(border: np.ndarray) -> list[list[int]]:
    """Return the closed walks along the border, each from its lowest vertex number."""
    following = dict(border.tolist())
    loops = []
    while following:
        loop = [min(following)]
        while following[loop[-1]] != loop[0]:
            loop.append(following.pop(loop[-1]))
        del following[loop[-1]]
        loops.append(loop)
    return loops


def _lid(loop: list[int]) -> np.ndarray:
    """Return triangles `[k - 2, 3]` that close `loop`, facing away from the mesh it borders."""
    # against the border's direction, as the missing faces ran
    ring = loop[::-1]
    low, high, triangles = 0, len(ring) - 1, []
    while high - low > 1:
        triangles.append((ring[low], ring[low + 1], ring[high]))
        low += 1
        if high - low > 1:
            triangles.append((ring[low], ring[high - 1], ring[high]))
            high -= 1
    return np.array(triangles)
