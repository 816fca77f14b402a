"""Laplacians of a mesh by ragged loops, float64: slow, readable beside the definition."""

import numpy as np


def one_rings(faces: np.ndarray, n: int) -> list[set[int]]:
    """Return the neighbours of every vertex."""
    rings: list[set[int]] = [set() for _ in range(n)]
    for triangle in faces:
        for i in triangle:
            rings[i] |= {int(j) for j in triangle if j != i}
    return rings


def uniform_laplacian(V: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the mean of each vertex' neighbours minus the vertex, `[n, 3]`; 0 without neighbours."""
    out = np.zeros(V.shape)
    for i, ring in enumerate(one_rings(faces, len(V))):
        if ring:
            out[i] = np.mean([V[j] for j in ring], axis=0) - V[i]
    return out


def cotangent_weights(template: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return `[n, n]`: half the sum of the two cotangents opposite each edge, clamped, rows sum to 1."""
    n = len(template)
    weight = np.zeros((n, n))
    for triangle in faces:
        for corner in range(3):
            o, a, b = (int(triangle[(corner + k) % 3]) for k in range(3))
            u, v = template[a] - template[o], template[b] - template[o]
            angle = np.arccos(u @ v / np.linalg.norm(u) / np.linalg.norm(v))
            cotangent = min(max(1 / np.tan(angle), 1e-6), 1e3)
            weight[a, b] += cotangent / 2
            weight[b, a] += cotangent / 2
    return weight / weight.sum(axis=1, keepdims=True)
