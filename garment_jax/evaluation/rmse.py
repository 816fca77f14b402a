"""Vertex distances between two sequences of the same mesh, in centimetres (method, "Metrics")."""

import numpy as np


def vertex_distance(V: np.ndarray, V_star: np.ndarray) -> np.ndarray:
    """Return each vertex's distance `[t, n]` in cm between `V` and `V_star` `[t, n, 3]` metres.

    Raises `ValueError` when the shapes differ: broadcasting would compare the wrong frames.
    """
    if V.shape != V_star.shape:
        raise ValueError(
            f"vertices {V.shape} and {V_star.shape} differ in shape; compare clips of the same "
            "garment and the same frames."
        )
    difference = V.astype(np.float64) - V_star.astype(np.float64)
    return 100.0 * np.linalg.norm(difference, axis=-1)


def rmse(V: np.ndarray, V_star: np.ndarray) -> float:
    """Return sqrt(mean squared vertex distance over vertices and frames), cm.

    `V`, `V_star` `[t, n, 3]` (or one frame `[n, 3]`) in metres, in one common frame.
    """
    return float(np.sqrt(np.mean(vertex_distance(V, V_star) ** 2)))


def rmse_per_frame(V: np.ndarray, V_star: np.ndarray) -> np.ndarray:
    """Return the RMSE over vertices of every frame, `[t]` cm.

    The clip's RMSE is the root of the mean of its squares, not its mean.
    """
    return np.sqrt(np.mean(vertex_distance(V, V_star) ** 2, axis=-1))
