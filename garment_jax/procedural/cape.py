"""A cape: open in front, pinned along the shoulders, hanging down the back behind the arms."""

import numpy as np

from garment_jax.procedural.clearance import check_outside
from garment_jax.procedural.contour import collider_vertices
from garment_jax.procedural.made import MadeGarment, check_count
from garment_jax.procedural.pinning import pins_of
from garment_jax.procedural.tube import PSI, Row, fitting_edge, make_tube
from garment_jax.structs import Collider, RiggedBody

EASE = 0.012  # metres behind the back's hindmost point
CURL = 0.2  # of the back's depth at the top by which the borders come forward


def make_cape(
    body: RiggedBody,
    collider: Collider,
    *,
    vertices: int = 900,
    length: float = 0.8,
    flare_degrees: float = 12.0,
) -> MadeGarment:
    """Return a cape of about `vertices` vertices and `length` metres, pinned along its upper border.

    As wide as the shoulders at the top, each border going out at `flare_degrees` from the vertical. Its
    borders are open: no seam, u from the left border around the back to the right one, v from 1 at the
    top to 0 at the hem. The template is its rest shape. Raises `ValueError` when it does not clear
    the body, or a number is out of range.
    """
    check_count(vertices)
    if not 0.2 <= length <= 1.2:
        raise ValueError(f"length={length} m must lie between 0.2 and 1.2; 0.8 ends at the knee.")
    if not 0.0 <= flare_degrees <= 40.0:
        raise ValueError(f"flare_degrees={flare_degrees} must lie between 0 and 40; 12 is usual.")
    arm = body.joints[body.joint_names.index("LeftArm")].astype(np.float64)
    top = float(arm[1]) + 0.02
    depth = _back(body, collider, top, length, abs(float(arm[0])))

    def rows(edge: float) -> list[Row]:
        count = max(round(length / (0.9 * edge)), 2)
        parts = np.linspace(0.0, 1.0, count + 1)
        flare = np.tan(np.radians(flare_degrees)) * length
        return [_row(top - s * length, abs(float(arm[0])) + s * flare, depth, 1.0 - s) for s in parts]

    edge = fitting_edge(rows, vertices, closed=False)
    tube = make_tube(rows(edge), edge, closed=False)
    check_outside(tube.garment, body, collider, f"flare_degrees={flare_degrees:g} puts the cape")
    pins = pins_of(tube.garment, np.arange(tube.counts[0]), body, collider, ring=False)
    return MadeGarment(tube.garment, pins, None)


def _back(
    body: RiggedBody, collider: Collider, top: float, length: float, width: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return heights (rising) and how far behind x = z = 0 the cape hangs there, metres.

    It hangs straight down from what stands out most above: shoulder blades, then the seat.
    """
    points = collider_vertices(body, collider)
    points = points[np.abs(points[:, 0]) < width]
    heights = np.linspace(top, top - length, 60)
    near = np.abs(points[:, 1] - heights[:, None]) < 0.03
    behind = np.where(near, -points[:, 2], -np.inf).max(axis=1)
    behind = np.maximum.accumulate(behind)
    smooth = np.convolve(np.pad(behind, 5, mode="edge"), np.ones(11) / 11, mode="valid")
    smooth += max(float((behind - smooth).max()), 0.0) + EASE
    return heights[::-1], smooth[::-1]


def _row(height: float, width: float, depth: tuple[np.ndarray, np.ndarray], v: float) -> Row:
    """Return a row of half width `width` that comes forward towards its borders."""
    across = PSI / np.pi
    back = float(np.interp(height, *depth))
    forward = CURL * float(depth[1][-1]) * (1.0 - np.cos(np.pi * across / 2))
    x, z = -width * np.sin(np.pi * across / 2), -back + forward
    return Row(np.stack([x, np.full(len(PSI), height), z], axis=1), v)
