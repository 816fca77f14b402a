"""A cone skirt: straight lines of one slope from the body's waist to the hem."""

import numpy as np

from garment_jax.procedural.clearance import check_outside
from garment_jax.procedural.contour import contour_around, cross_section, curve, outward, radius
from garment_jax.procedural.made import MadeGarment, check_count
from garment_jax.procedural.pinning import pins_of
from garment_jax.procedural.tube import PSI, Row, Tube, fitting_edge, make_tube
from garment_jax.structs import Collider, RiggedBody

EASE = 0.006  # metres between the skin and the waist
WAIST = 0.48  # of the way from the hips' joint to the chest's (Spine1): where the belly is narrowest


def make_cone_skirt(
    body: RiggedBody,
    collider: Collider,
    *,
    vertices: int = 900,
    length: float = 0.6,
    slope_degrees: float = 29.0,
    height: float | None = None,
) -> MadeGarment:
    """Return a skirt of about `vertices` vertices and `length` metres, pinned all around its waist.

    The waist is the body's smoothed convex contour at `height` (metres; the narrowest place by default)
    with 6 mm of ease; from there lines fall at `slope_degrees` from the vertical, square to the
    contour. Such a surface is developable: the pattern is its exact unrolling. UVs: u around from the
    back seam, v from 1 at the waist to 0 at the hem. Raises `ValueError` when the slope leaves the
    skirt inside the body, or a number is out of range.
    """
    _check(vertices, length, slope_degrees)
    height = waist_height(body) if height is None else height
    waist = contour_around(cross_section(body, collider, height), EASE)
    slope, around = float(np.radians(slope_degrees)), curve(waist, PSI)

    def rows(edge: float) -> list[Row]:
        count = max(round(length / (0.9 * edge)), 2)
        return [
            cone_row(around, height, slope, s * length, 1.0 - s) for s in np.linspace(0.0, 1.0, count + 1)
        ]

    edge = fitting_edge(rows, vertices)
    tube = make_tube(rows(edge), edge)
    check_outside(tube.garment, body, collider, f"slope_degrees={slope_degrees:g} puts the skirt")
    pins = pins_of(tube.garment, np.arange(tube.counts[0]), body, collider, ring=True)
    return MadeGarment(tube.garment, pins, _unrolled(tube, waist, slope, length))


def waist_height(body: RiggedBody) -> float:
    """Return the height of a body's waist, metres."""
    hips, chest = (float(body.joints[body.joint_names.index(name)][1]) for name in ("Hips", "Spine1"))
    return hips + WAIST * (chest - hips)


def cone_row(waist: np.ndarray, height: float, slope: float, along: float, v: float) -> Row:
    """Return the row `along` metres down a cone of `slope` (radians) from the curve `waist` `[721, 2]`."""
    xz = waist + along * np.sin(slope) * outward(PSI)
    return Row(np.insert(xz, 1, height - along * np.cos(slope), axis=1), v)


def _unrolled(tube: Tube, waist: np.ndarray, slope: float, length: float) -> np.ndarray:
    """Return the flat pattern `[u, 2]`: the waist bends in the plane by sin(slope) of its turn in space."""
    fine = np.linspace(0.0, 2 * np.pi, 5761)
    bend = np.sin(slope) * fine
    velocity = radius(waist, fine)[:, None] * np.stack([np.cos(bend), np.sin(bend)], axis=1)
    path = np.cumsum((velocity[1:] + velocity[:-1]) / 2, axis=0) * fine[1]
    path = np.concatenate([np.zeros((1, 2)), path])
    at = np.stack([np.interp(tube.psi, fine, path[:, k]) for k in range(2)], axis=1)
    down = np.stack([np.sin(np.sin(slope) * tube.psi), -np.cos(np.sin(slope) * tube.psi)], axis=1)
    along = (1.0 - tube.garment.uv[:, 1].astype(np.float64)) * length
    return at + along[:, None] * down


def _check(vertices: int, length: float, slope_degrees: float) -> None:
    check_count(vertices)
    if not 0.1 <= length <= 0.9:
        raise ValueError(f"length={length} m must lie between 0.1 and 0.9; 0.6 ends below the knee.")
    if not 0.0 < slope_degrees < 80.0:
        raise ValueError(f"slope_degrees={slope_degrees} must lie between 0 and 80; 29 is usual.")
