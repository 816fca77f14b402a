"""A strapless A-line dress: a bodice on the body's contours, a cone from the waist down."""

import numpy as np
from scipy.interpolate import PchipInterpolator

from garment_jax.procedural.clearance import check_outside
from garment_jax.procedural.cone_skirt import cone_row, waist_height
from garment_jax.procedural.contour import contour_around, cross_section, curve, outward
from garment_jax.procedural.made import MadeGarment, check_count
from garment_jax.procedural.pinning import pins_of
from garment_jax.procedural.tube import PSI, Row, fitting_edge, make_tube
from garment_jax.structs import Collider, RiggedBody

EASE = 0.012  # metres between the skin and the bodice


def make_dress(
    body: RiggedBody,
    collider: Collider,
    *,
    vertices: int = 900,
    length: float = 0.55,
    slope_degrees: float = 26.0,
) -> MadeGarment:
    """Return a dress of about `vertices` vertices, pinned along its neckline.

    The neckline runs over the bust in front, below the arms at the sides and across the shoulder blades;
    the skirt falls `length` metres from the waist at `slope_degrees`. UVs as the cone skirt's. It has
    no flat pattern: a bodice of one piece is not developable, its rest shape is the template. Raises
    `ValueError` when it does not clear the body, or a number is out of range.
    """
    check_count(vertices)
    if not 0.1 <= length <= 0.9:
        raise ValueError(f"length={length} m must lie between 0.1 and 0.9; 0.55 ends at the knee.")
    if not 0.0 < slope_degrees < 80.0:
        raise ValueError(f"slope_degrees={slope_degrees} must lie between 0 and 80; 26 is usual.")
    waist, top = waist_height(body), _neckline(body)
    bodice = _bodice(body, collider, waist, float(top.max()))
    around = curve(bodice(waist), PSI)
    slope, rise = float(np.radians(slope_degrees)), float(top.mean()) - waist

    def rows(edge: float) -> list[Row]:
        upper, lower = (max(round(part / (0.9 * edge)), 2) for part in (rise, length))
        v = np.linspace(1.0, length / (rise + length), upper + 1)
        parts = np.linspace(0.0, 1.0, upper + 1)[:-1]
        heights = [top + s * (waist - top) for s in parts]
        out = [Row(_at(bodice, y), float(w)) for y, w in zip(heights, v[:-1], strict=True)]
        fall = np.linspace(0.0, 1.0, lower + 1)
        return out + [cone_row(around, waist, slope, s * length, float(v[-1] * (1 - s))) for s in fall]

    edge = fitting_edge(rows, vertices)
    tube = make_tube(rows(edge), edge)
    check_outside(tube.garment, body, collider, f"slope_degrees={slope_degrees:g} puts the dress")
    pins = pins_of(tube.garment, np.arange(tube.counts[0]), body, collider, ring=True)
    return MadeGarment(tube.garment, pins, None)


def _neckline(body: RiggedBody) -> np.ndarray:
    """Return the height of the neckline at every angle of `PSI`, metres: low under the arms."""
    chest, arm = (float(body.joints[body.joint_names.index(name)][1]) for name in ("Spine1", "LeftArm"))
    low = chest - 1.35 * (arm - chest)
    return low + 1.3 * (arm - chest) * np.abs(np.cos(PSI)) ** 1.5


def _bodice(body: RiggedBody, collider: Collider, low: float, high: float) -> PchipInterpolator:
    """Return the contour's coefficients by height, between the waist and the neckline's highest point."""
    half_width = 0.95 * abs(float(body.joints[body.joint_names.index("LeftArm")][0]))
    heights = np.linspace(low, high, 12)
    contours = []
    for height in heights:
        section = cross_section(body, collider, height)
        contours.append(contour_around(section[np.abs(section[:, 0]) < half_width], EASE))
    return PchipInterpolator(heights, np.array(contours))


def _at(bodice: PchipInterpolator, heights: np.ndarray) -> np.ndarray:
    """Return the bodice's points `[721, 3]` at these heights, one for each angle of `PSI`."""
    contours = bodice(heights)
    tangent = np.stack([-np.cos(PSI), np.sin(PSI)], axis=1)
    k = np.arange(contours.shape[1])
    h = (contours * np.cos(PSI[:, None] * k)).sum(axis=1, keepdims=True)
    slope = (contours * -k * np.sin(PSI[:, None] * k)).sum(axis=1, keepdims=True)
    return np.insert(h * outward(PSI) + slope * tangent, 1, heights, axis=1)
