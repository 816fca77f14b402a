"""A circle skirt: a full ring of cloth, which hangs in folds from the waist."""

from collections.abc import Callable

import numpy as np

from garment_jax.procedural.clearance import check_outside
from garment_jax.procedural.cone_skirt import EASE, waist_height
from garment_jax.procedural.contour import contour_around, cross_section, curve, outward
from garment_jax.procedural.made import MadeGarment, check_count
from garment_jax.procedural.pinning import pins_of
from garment_jax.procedural.tube import PSI, Row, Tube, fitting_edge, make_tube
from garment_jax.structs import Collider, RiggedBody

FINE = 80  # steps from the waist to the hem in which the folds are grown


def make_circle_skirt(
    body: RiggedBody,
    collider: Collider,
    *,
    vertices: int = 900,
    length: float = 0.5,
    slope_degrees: float = 38.0,
    folds: int = 8,
) -> MadeGarment:
    """Return a full-circle skirt of about `vertices` vertices, pinned all around its waist.

    The pattern is a whole ring: the waist's length around an inner circle, `length` metres wide. The
    template takes up the pattern's width in `folds` (even) folds of a cone of `slope_degrees`: rows
    and lines from waist to hem have the pattern's lengths, only the angles between them differ. UVs as
    the cone skirt's. Raises `ValueError` for numbers out of range.
    """
    _check(vertices, length, slope_degrees, folds)
    waist = contour_around(cross_section(body, collider, waist_height(body)), EASE)
    fine = _folded(waist, waist_height(body), length, float(np.radians(slope_degrees)), folds)

    def rows(edge: float) -> list[Row]:
        part = np.linspace(0.0, 1.0, max(round(length / (0.9 * edge)), 2) + 1)
        at, place = np.floor(part * FINE).astype(int), part * FINE
        upper, lower = fine[at], fine[np.minimum(at + 1, FINE)]
        paths = upper + (place - at)[:, None, None] * (lower - upper)
        return [Row(path, float(1.0 - s)) for path, s in zip(paths, part, strict=True)]

    edge = fitting_edge(rows, vertices)
    tube = make_tube(rows(edge), edge)
    check_outside(tube.garment, body, collider, f"slope_degrees={slope_degrees:g} puts the skirt")
    pins = pins_of(tube.garment, np.arange(tube.counts[0]), body, collider, ring=True)
    return MadeGarment(tube.garment, pins, _ring_pattern(tube, float(waist[0]), length))


def _folded(waist: np.ndarray, height: float, length: float, slope: float, folds: int) -> np.ndarray:
    """Return the surface's fine rows `[FINE + 1, 721, 3]`, metres.

    Row by row: the folds are as deep as makes the row as long as the pattern's, and each point falls by
    what its sideways step leaves of the step's length.
    """
    step, wave = length / FINE, np.cos(folds * PSI)
    around, normal = curve(waist, PSI), outward(PSI)
    y, out, depth = np.full(len(PSI), height), np.zeros(len(PSI)), 0.0
    rows = [np.insert(around, 1, y, axis=1)]

    def row(deep: float, at: float, above: np.ndarray, before: np.ndarray) -> np.ndarray:
        now = at * np.sin(slope) + deep * wave
        # at most 98 % of a step goes sideways: the cloth falls everywhere
        aside = np.clip(now - before, -0.98 * step, 0.98 * step)
        path = around + (before + aside)[:, None] * normal
        return np.insert(path, 1, above - np.sqrt(step**2 - aside**2), axis=1)

    for k in range(1, FINE + 1):
        fixed = (k * step, y, out)
        depth = _deepening(row, fixed, np.pi * (waist[0] + k * step), depth, depth + step)
        rows.append(row(depth, *fixed))
        y, out = rows[-1][:, 1], ((rows[-1][:, [0, 2]] - around) * normal).sum(axis=1)
    return np.array(rows)


def _length(path: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _deepening(row: Callable, fixed: tuple, target: float, low: float, high: float) -> float:
    """Return the depth between `low` and `high` at which the half row is `target` long, or an end."""
    for _ in range(16):
        middle = (low + high) / 2
        low, high = (low, middle) if _length(row(middle, *fixed)) > target else (middle, high)
    return (low + high) / 2


def _ring_pattern(tube: Tube, inner: float, length: float) -> np.ndarray:
    """Return the flat ring `[u, 2]`: the seam's two sides meet at angle 0."""
    radius = inner + (1.0 - tube.garment.uv[:, 1].astype(np.float64)) * length
    angle = 2 * np.pi * tube.fraction
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _check(vertices: int, length: float, slope_degrees: float, folds: int) -> None:
    check_count(vertices)
    if not 0.1 <= length <= 0.8:
        raise ValueError(f"length={length} m must lie between 0.1 and 0.8; 0.5 ends at the knee.")
    if not 20.0 <= slope_degrees <= 80.0:
        raise ValueError(f"slope_degrees={slope_degrees} must lie between 20 and 80; 38 is usual.")
    if folds < 4 or folds % 2:
        raise ValueError(f"folds={folds} must be even and at least 4; 8 is usual.")
