"""Symmetric Hausdorff distance, vertex to surface, in centimetres (method, "Metrics")."""

import numpy as np

from garment_jax.evaluation.surface import farthest, make_surface


def hausdorff_frame(V: np.ndarray, V_star: np.ndarray, faces: np.ndarray) -> float:
    """Return the larger of the two one-sided distances of one frame, cm.

    One side is the farthest that a vertex of `V` `[n, 3]` (metres) lies from the *surface* of
    `V_star`, the other the reverse; exact (see `surface.py`).
    """
    there = farthest(V, make_surface(V_star, faces))
    return 100.0 * farthest(V_star, make_surface(V, faces), at_least=there)


def hausdorff(V: np.ndarray, V_star: np.ndarray, faces: np.ndarray, *, every: int = 1) -> float:
    """Return the Hausdorff distance of `[t, n, 3]` sequences: the mean over every k-th frame, cm."""
    if every < 1:
        raise ValueError(f"--every {every} must be 1 or more; 1 measures all frames.")
    pairs = zip(V[::every], V_star[::every], strict=True)
    return float(np.mean([hausdorff_frame(v, w, faces) for v, w in pairs]))
