"""Softmax skinning by seeds and its inverse, vertex by vertex in float64."""

import numpy as np


def softmax_weights(points: np.ndarray, seeds: np.ndarray, tau: float) -> np.ndarray:
    """Return exp(-d / tau), rows divided by their sum, `[n, m]`; the largest exponent is taken out."""
    W = np.zeros((len(points), len(seeds)))
    for i, x in enumerate(points):
        exponent = np.array([-np.sqrt(((x - s) ** 2).sum()) / tau for s in seeds])
        row = np.exp(exponent - exponent.max())
        W[i] = row / row.sum()
    return W


def skin(points: np.ndarray, W: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return sum_j W_ij (R_j x_i + t_j), `[n, 3]`."""
    out = np.zeros(points.shape)
    for i, x in enumerate(points):
        for j in range(len(R)):
            out[i] += W[i, j] * (R[j] @ x + t[j])
    return out


def unskin(V: np.ndarray, W: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the points that `skin` takes to `V`: each vertex' blended 3 x 3 system solved, undamped."""
    out = np.zeros(V.shape)
    for i, v in enumerate(V):
        A = sum(W[i, j] * R[j] for j in range(len(R)))
        b = sum(W[i, j] * t[j] for j in range(len(R)))
        out[i] = np.linalg.solve(A, v - b)
    return out
