"""Polygons as fans of triangles."""

import numpy as np


def fan_corners(counts: np.ndarray) -> np.ndarray:
    """Return the corners `[f, 3]` int64 of the triangle fans of polygons with `counts` `[p]` corners.

    Indices into the polygons' corners, one polygon after the other. Those with fewer than 3 give none.
    """
    counts = np.asarray(counts, np.int64)
    triangles = np.maximum(counts - 2, 0)
    first = np.repeat(np.cumsum(counts) - counts, triangles)
    k = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([first, first + k + 1, first + k + 2], axis=1)
