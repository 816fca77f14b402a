"""Convex contours around a body, as left-right symmetric support functions.

h(psi) is how far the contour reaches in the horizontal direction (-sin psi, -cos psi) of (x, z): psi runs
from the back (0) by the body's right to the front (pi) and on. It is a cosine series, so the contour is
exactly symmetric in x, its curve, tangent and parallel curves are closed forms, and h + d is the
contour moved outwards by d.
"""

import numpy as np

from garment_jax.structs import Collider, RiggedBody

HARMONICS = 24
SAMPLES = 720
_PSI = 2 * np.pi * np.arange(SAMPLES) / SAMPLES


def series(h: np.ndarray) -> np.ndarray:
    """Return the cosine coefficients `[HARMONICS]` of a support function sampled at `SAMPLES` angles."""
    coefficients = np.fft.rfft(h).real[:HARMONICS] / SAMPLES
    coefficients[1:] *= 2.0
    return coefficients


def reach(coefficients: np.ndarray, psi: np.ndarray, derivative: int = 0) -> np.ndarray:
    """Return h or its first or second derivative at `psi` `[q]`; `coefficients` `[k]` in metres."""
    k = np.arange(len(coefficients))
    angle = psi[:, None] * k
    wave = (np.cos(angle), -k * np.sin(angle), -k * k * np.cos(angle))[derivative]
    return wave @ coefficients


def outward(psi: np.ndarray) -> np.ndarray:
    """Return the horizontal directions `[q, 2]` (x, z) of the angles `psi`."""
    return np.stack([-np.sin(psi), -np.cos(psi)], axis=1)


def curve(coefficients: np.ndarray, psi: np.ndarray) -> np.ndarray:
    """Return the contour's points `[q, 2]` (x, z) whose outward normal points to `psi`."""
    tangent = np.stack([-np.cos(psi), np.sin(psi)], axis=1)
    h, slope = reach(coefficients, psi), reach(coefficients, psi, 1)
    return h[:, None] * outward(psi) + slope[:, None] * tangent


def radius(coefficients: np.ndarray, psi: np.ndarray) -> np.ndarray:
    """Return the radius of curvature `[q]`, metres: the curve's speed in psi; negative where it folds."""
    return reach(coefficients, psi) + reach(coefficients, psi, 2)


def hull_reach(points: np.ndarray) -> np.ndarray:
    """Return the support function of `points` `[q, 2]` and their mirror images at `SAMPLES` angles."""
    both = np.concatenate([points, points * [-1.0, 1.0]])
    return (outward(_PSI) @ both.T).max(axis=1)


def contour_around(points: np.ndarray, ease: float, *, rounding: float = 10.0) -> np.ndarray:
    """Return the coefficients of a smooth contour that keeps `ease` metres from `points` `[q, 2]` or more.

    The convex hull, averaged over turns of about `rounding` degrees (an average of convex contours is
    convex), then moved outwards until it clears the hull everywhere.
    """
    raw = hull_reach(points)
    smooth = series(raw) * np.exp(-np.square(np.radians(rounding) * np.arange(HARMONICS)) / 2)
    smooth[0] += max(float((raw - reach(smooth, _PSI)).max()), 0.0) + ease
    return smooth


def cross_section(body: RiggedBody, collider: Collider, height: float) -> np.ndarray:
    """Return where the collider's edges cross the plane y = `height`, `[q, 2]` (x, z) metres.

    Raises `ValueError` when the plane misses the collider.
    """
    points = collider_vertices(body, collider)
    a = points[collider.faces].reshape(-1, 3)
    b = points[np.roll(collider.faces, -1, axis=1)].reshape(-1, 3)
    crossing = (a[:, 1] < height) & (b[:, 1] >= height)  # every edge runs once each way
    if not crossing.any():
        low, high = points[:, 1].min(), points[:, 1].max()
        raise ValueError(
            f"height={height:.3g} misses the collider, which spans {low:.3g} to {high:.3g} m; "
            "choose a height between."
        )
    a, b = a[crossing], b[crossing]
    t = (height - a[:, 1:2]) / (b[:, 1:2] - a[:, 1:2])
    return (a + t * (b - a))[:, [0, 2]]


def collider_vertices(body: RiggedBody, collider: Collider) -> np.ndarray:
    """Return the canonical collider's vertices `[c, 3]` float64, the cap's last where there is one."""
    points = body.vertices.astype(np.float64)
    if not len(collider.cap_loop):
        return points[collider.body_vertices]
    return np.concatenate([points[collider.body_vertices], points[collider.cap_loop].mean(0)[None]])
