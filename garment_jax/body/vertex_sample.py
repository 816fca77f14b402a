"""Some vertices of a mesh, spread evenly over it: dense faces and hands would count for too much."""

import numpy as np


def spread_vertices(points: np.ndarray, most: int) -> np.ndarray:
    """Return ascending indices of at most `most` of `points` `[n, 3]`: one of each cell of a grid.

    The finest grid (to a few percent) that leaves no more; of a cell's points the first one.
    """
    if len(points) <= most:
        return np.arange(len(points))
    low = points.min(axis=0)
    small, large = 0.0, float(np.ptp(points, axis=0).max()) * 1.001 + 1e-9
    chosen = np.zeros(1, np.int64)
    for _ in range(12):
        size = (small + large) / 2
        cells = ((points - low) / size).astype(np.int64)
        found = np.unique(cells, axis=0, return_index=True)[1]
        if len(found) > most:
            small = size
        else:
            large, chosen = size, found
    return np.sort(chosen)


def surface_centre(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the centre `[3]` of the surface of `faces` `[f, 3]`, the points' mean where it has no area."""
    corners = points[faces].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    if area.sum() <= 0:
        return points.astype(np.float64).mean(axis=0)
    return area @ corners.mean(axis=1) / area.sum()
