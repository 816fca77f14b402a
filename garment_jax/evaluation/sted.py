"""Spatio-temporal edge difference after Vasa and Skala (2011), dimensionless.

"A perception correlated comparison method for dynamic meshes". Settings, stated with every result
because neither the garment papers nor their figures do: neighbourhood = one-ring; window in
frames; c. Absolute values cannot be compared across papers, ratios between methods can.
"""

from typing import NamedTuple

import numpy as np

from garment_jax.geometry.topology import unique_edges

WINDOW = 15  # frames, half a second at 30 fps
WEIGHT = 0.1  # the default c: on dancing skirts it brings both parts to the same order
FLOOR = 1e-4  # metres a frame; below this mean speed the window counts as moving at this speed


class Sted(NamedTuple):
    """The metric and its settings."""

    combined: float  # sqrt(spatial^2 + c^2 temporal^2)
    spatial: float
    temporal: float
    c: float
    window_frames: int
    neighbourhood: str


def spatial_part(V: np.ndarray, V_star: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the local deviation of relative edge differences, `[t, n]`, no unit.

    For vertex i the standard deviation over the edges e of its one-ring of
    (|e| - |e*|) / |e*|, each edge weighted by |e*|. A uniform scaling costs nothing: only uneven
    stretch is seen. `V`, `V_star` `[t, n, 3]`, `edges` `[k, 2]`. Edges without length are left out.
    """
    true = _lengths(V_star, edges)
    safe = np.where(true > 0, true, 1.0)
    relative = np.where(true > 0, (_lengths(V, edges) - true) / safe, 0.0)
    n = V.shape[1]
    weight = _ring_sum(true, edges, n)
    weight = np.where(weight > 0, weight, 1.0)
    mean = _ring_sum(true * relative, edges, n) / weight
    spread = np.zeros_like(mean)
    for side in (0, 1):  # centred before squaring: E[x^2] - E[x]^2 loses the digits of a small spread
        at = edges[:, side]
        spread += _scatter(true * (relative - mean[:, at]) ** 2, at, n)
    return np.sqrt(spread / weight)


def _lengths(V: np.ndarray, edges: np.ndarray) -> np.ndarray:
    V = V.astype(np.float64)
    return np.linalg.norm(V[:, edges[:, 1]] - V[:, edges[:, 0]], axis=-1)


def _scatter(values: np.ndarray, at: np.ndarray, n: int) -> np.ndarray:
    return np.stack([np.bincount(at, row, minlength=n) for row in values])


def _ring_sum(values: np.ndarray, edges: np.ndarray, n: int) -> np.ndarray:
    """Sum edge `values` `[t, k]` into both end vertices, `[t, n]`."""
    return _scatter(values, edges[:, 0], n) + _scatter(values, edges[:, 1], n)


def steps(V: np.ndarray) -> np.ndarray:
    """Return the virtual edges' lengths `[t - 1, n]`, metres: a vertex to itself in the next frame."""
    return np.linalg.norm(np.diff(V.astype(np.float64), axis=0), axis=-1)


def temporal_part(V: np.ndarray, V_star: np.ndarray, *, window_frames: int = WINDOW) -> np.ndarray:
    """Return the relative differences of virtual edges `[t - 1, n]`, no unit.

    | |s| - |s*| | over the mean of |s*| in a window of `window_frames` steps centred on the step
    (cut off at the clip's ends). Where the true vertex hardly moves in the whole window the
    denominator is `FLOOR`, so a still clip gives a finite number.
    """
    check_window(window_frames)
    true, half = steps(V_star), window_frames // 2
    total = np.concatenate([np.zeros_like(true[:1]), np.cumsum(true, axis=0)])
    index = np.arange(len(true))
    low, high = np.maximum(index - half, 0), np.minimum(index + half + 1, len(true))
    mean = (total[high] - total[low]) / (high - low)[:, None]
    return np.abs(steps(V) - true) / np.maximum(mean, FLOOR)


def check_window(window_frames: int) -> None:
    """Raise `ValueError` unless the window is a positive odd number of frames."""
    if window_frames < 1 or window_frames % 2 == 0:
        raise ValueError(f"window_frames={window_frames} must be a positive odd number; try {WINDOW}.")


def combine(spatial: float, temporal: float, *, c: float = WEIGHT, window_frames: int = WINDOW) -> Sted:
    """Return STED = sqrt(spatial^2 + c^2 temporal^2) with its settings."""
    combined = float(np.hypot(spatial, c * temporal))
    return Sted(combined, float(spatial), float(temporal), c, window_frames, "one-ring")


def sted(
    V: np.ndarray, V_star: np.ndarray, faces: np.ndarray, *, c: float = WEIGHT, window_frames: int = WINDOW
) -> Sted:
    """Return the STED of two sequences `[t, n, 3]` (metres, t >= 2, translation of the root removed)."""
    if len(V) < 2:
        raise ValueError(f"STED needs 2 frames or more, not {len(V)}; evaluate a longer clip.")
    spatial = spatial_part(V, V_star, unique_edges(faces)).mean()
    temporal = temporal_part(V, V_star, window_frames=window_frames).mean()
    return combine(spatial, temporal, c=c, window_frames=window_frames)
