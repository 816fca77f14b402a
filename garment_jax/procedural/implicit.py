"""Implicit solids: fields that are negative inside and about the distance in metres near the surface."""

import numpy as np
from scipy.interpolate import PchipInterpolator


def smooth_union(*fields: np.ndarray, width: float) -> np.ndarray:
    """Return the union of `fields` `[q]`, rounded where two surfaces lie within `width` metres.

    The polynomial minimum of Quilez: min(a, b) minus a fillet that ends where |a - b| = width.
    """
    total = fields[0]
    for field in fields[1:]:
        overlap = np.maximum(width - np.abs(total - field), 0.0) / width
        total = np.minimum(total, field) - overlap**3 * width / 6.0
    return total


def ellipsoid(points: np.ndarray, centre: tuple, radii: tuple) -> np.ndarray:
    """Return the field `[q]` of an axis-aligned ellipsoid (exact at the surface, first order near it)."""
    away = (points - np.array(centre)) / np.array(radii)
    k = np.linalg.norm(away, axis=1)
    slope = np.linalg.norm(away / np.array(radii), axis=1)
    return k * (k - 1.0) / np.maximum(slope, 1e-9)


def limb(points: np.ndarray, spine: np.ndarray, squash: np.ndarray | None = None) -> np.ndarray:
    """Return the field `[q]` of a chain of tapered capsules through `spine` `[k, 4]` (x, y, z, radius).

    `squash` `[3, 3]` is a linear map of space that is applied to all positions first.
    """
    space = np.eye(3) if squash is None else squash
    q, centres, radii = points @ space.T, spine[:, :3] @ space.T, spine[:, 3]
    best = np.full(len(points), np.inf)
    for a, b, ra, rb in zip(centres[:-1], centres[1:], radii[:-1], radii[1:], strict=True):
        t = np.clip((q - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        distance = np.linalg.norm(q - a - t[:, None] * (b - a), axis=1) - (ra + t * (rb - ra))
        best = np.minimum(best, distance)
    return best


def resampled(spine: np.ndarray, pieces: int = 4) -> np.ndarray:
    """Return `spine` `[k, 4]` with `pieces` stations for one, its radii rounded, its axis unbent."""
    knots = np.arange(len(spine))
    at = np.linspace(0, len(spine) - 1, pieces * (len(spine) - 1) + 1)
    axis = np.stack([np.interp(at, knots, spine[:, k]) for k in range(3)], axis=1)
    return np.column_stack([axis, PchipInterpolator(knots, spine[:, 3])(at)])


def column(points: np.ndarray, profile: np.ndarray, *, power: float = 2.0) -> np.ndarray:
    """Return the field `[q]` of an upright body with elliptic sections.

    `profile` `[k, 5]`: height, centre x, centre z, half width, half depth, from the bottom up, in
    metres. `power` above 2 makes the sections boxier.
    """
    height = np.clip(points[:, 1], profile[0, 0], profile[-1, 0])
    cx, cz, a, b = PchipInterpolator(profile[:, 0], profile[:, 1:])(height).T
    x, z = np.abs(points[:, 0] - cx), np.abs(points[:, 2] - cz)
    rho = ((x / a) ** power + (z / b) ** power) ** (1.0 / power)
    sideways = (rho - 1.0) * np.sqrt(a * b)
    beyond = np.abs(points[:, 1] - height)
    outside = np.hypot(np.maximum(sideways, 0.0), beyond)
    return np.where(beyond > 0, outside, sideways)
