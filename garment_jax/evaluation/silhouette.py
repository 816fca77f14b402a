"""The area of a garment's silhouette, which chance leaves alone where it moves single folds."""

import numpy as np

from garment_jax.evaluation.rasteriser import rasterise

PIXELS_PER_METRE = 200


def silhouette_cm2(V: np.ndarray, faces: np.ndarray, yaw: float) -> float:
    """Return the area in cm² that a garment covers, the mean of the views from the front and from the side.

    Parallel projection, pixels of half a centimetre. `V` `[n, 3]` metres, Y up; `yaw`: where the body looks.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    side, ahead = V[:, 0] * c - V[:, 2] * s, V[:, 0] * s + V[:, 2] * c
    areas = []
    for across in (side, ahead):
        xy = PIXELS_PER_METRE * np.stack([across - across.min(), V[:, 1].max() - V[:, 1]], axis=1)
        width, height = np.ceil(xy.max(axis=0)).astype(int) + 1
        seen = rasterise(xy, np.zeros(len(V)), faces, height=int(height), width=int(width)).face >= 0
        areas.append(seen.sum() * (100.0 / PIXELS_PER_METRE) ** 2)
    return float(np.mean(areas))
