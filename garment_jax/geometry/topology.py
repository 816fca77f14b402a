"""Connectivity of a triangle mesh: edges and padded neighbour tables (host, NumPy)."""

from typing import NamedTuple

import numpy as np


class Neighbours(NamedTuple):
    """One-ring of every vertex, padded to the largest valence (static)."""

    index: np.ndarray  # [n, k] int32; padding repeats the vertex itself
    mask: np.ndarray  # [n, k] float32, 1 for a neighbour, 0 for padding


def unique_edges(faces: np.ndarray) -> np.ndarray:
    """Return the undirected edges `[e, 2]` (int32, each row ascending, rows sorted) of `[f, 3]`."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.unique(np.sort(pairs, axis=1), axis=0).astype(np.int32)


def neighbour_table(faces: np.ndarray, n: int) -> Neighbours:
    """Return the padded one-ring of `n` vertices; ragged lists would cost a scatter per frame.

    Raises `ValueError` when a face names a vertex that does not exist.
    """
    if faces.size and (faces.min() < 0 or faces.max() >= n):
        bad = faces.min() if faces.min() < 0 else faces.max()
        raise ValueError(f"faces name vertex {bad} of a mesh with {n} vertices; they count from 0.")
    edges = unique_edges(faces)
    both = np.concatenate([edges, edges[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    valence = np.bincount(both[:, 0], minlength=n)
    k = max(int(valence.max(initial=0)), 1)
    slot = np.arange(len(both)) - np.repeat(np.cumsum(valence) - valence, valence)
    index = np.tile(np.arange(n, dtype=np.int32)[:, None], (1, k))
    mask = np.zeros((n, k), np.float32)
    index[both[:, 0], slot] = both[:, 1]
    mask[both[:, 0], slot] = 1.0
    return Neighbours(index, mask)
