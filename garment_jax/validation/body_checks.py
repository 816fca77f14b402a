"""Is a rigged body whole, in metres, upright and outward? (host, NumPy)"""

import numpy as np

from garment_jax.geometry.boundary import boundary_edges
from garment_jax.importers.finding import Finding, Repair, rows
from garment_jax.structs import RiggedBody

UNITS = {"m": 1.0, "cm": 100.0, "mm": 1000.0, "inches": 39.37, "feet": 3.281}  # of each in a metre
SMALLEST, LARGEST = 0.05, 5.0  # metres, as `data.validation`
PERSON = (0.9, 2.4)  # metres from the soles to the crown, or from hand to hand
_UPRIGHT = 1.3  # a body is this many times taller along its up axis than deep
_FLOAT, _SINK = 0.05, 0.3  # metres between the soles and the floor: worth a note, a warning
_SUM = 1e-3  # of a vertex' weights, from 1; as `data.layout`
_STRAY = 0.25  # of the body's size that a joint may be outside its box


def extent(points: np.ndarray) -> float:
    """Return the longest side of the box around `points` `[q, 3]`."""
    return float(np.ptp(points, axis=0).max())


def likely_units(size: float) -> list[str]:
    """Return the units in which `size` is that of a person."""
    return [unit for unit, factor in UNITS.items() if PERSON[0] <= size / factor <= PERSON[1]]


def body_unit(body: RiggedBody) -> Finding:
    """Return the finding on the unit; a repair `unit` (metres per unit) where one alone is possible."""
    size, possible = extent(body.vertices), likely_units(extent(body.vertices))
    if "m" in possible:
        return Finding("body unit", "ok", f"{size:.2f} m large")
    decimal = [unit for unit in possible if unit in ("cm", "mm")]
    if not SMALLEST <= size <= LARGEST or decimal:
        guess = f"looks like {' or '.join(possible)}" if possible else "is that of no person in any unit"
        certain = len(possible) == 1 and bool(decimal)
        return Finding(
            "body unit",
            "error",
            f"the body is {size:.4g} large, which {guess}",
            remedy="convert all lengths to metres" + (" (--fix does)" if certain else ""),
            repair=Repair("unit", 1 / UNITS[possible[0]]) if certain else None,
        )
    return Finding(
        "body unit",
        "note",
        f"the body is {size:.2f} m large",
        remedy="check the unit if it is a grown person",
    )


def body_up(body: RiggedBody) -> str:
    """Return the axis along which the body stands: "Z" where it is much taller along Z than along Y."""
    size = np.ptp(np.concatenate([body.vertices, body.joints]), axis=0)
    return "Z" if size[2] > _UPRIGHT * size[1] else "Y"


def check_body(body: RiggedBody) -> list[Finding]:
    """Return the findings on a body in metres and Y up (unit and up axis are looked at before)."""
    return [
        *check_weights(body.skin_weights, "skin weights", body.joint_names),
        _joints(body),
        _floor(body),
        *_surface(body),
    ]


def check_weights(weights: np.ndarray, name: str, joints: tuple[str, ...] = ()) -> list[Finding]:
    """Return the findings on skinning weights `[q, j]`: sums, signs, joints that carry nothing."""
    total = weights.astype(np.float64).sum(axis=1)
    wrong = np.flatnonzero(~(np.abs(total - 1) <= _SUM))
    found = []
    if len(wrong):
        usable = bool(np.isfinite(weights).all() and (total > 1e-6).all() and weights.min() >= 0)
        found.append(
            Finding(
                name,
                "error",
                f"{len(wrong)} of {len(total)} vertices' weights sum to {total[wrong[0]]:.4g}, not 1",
                rows("vertex", wrong),
                "normalise each vertex' weights to 1" + (" (--fix does)" if usable else ""),
                Repair("weights") if usable else None,
            )
        )
    negative = np.flatnonzero((weights < -1e-4).any(axis=1))
    if len(negative):
        found.append(
            Finding(
                name,
                "warning",
                f"{len(negative)} vertices have negative weights",
                rows("vertex", negative),
                "clamp them to 0 and normalise",
            )
        )
    found = found or [Finding(name, "ok", "rows sum to 1")]
    idle = [
        joint for joint, used in zip(joints, np.asarray((weights > 0).any(axis=0)), strict=False) if not used
    ]
    if idle:
        shown = ", ".join(idle[:3]) + (" …" if len(idle) > 3 else "")
        found.append(Finding("joints without weight", "note", f"{len(idle)} joints move no vertex", shown))
    return found


def _joints(body: RiggedBody) -> Finding:
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    outside = np.maximum(low - body.joints, body.joints - high).max(axis=1)
    stray = np.flatnonzero(outside > _STRAY * extent(body.vertices))
    if not len(stray):
        return Finding("joints", "ok", "within the body")
    names = ", ".join(body.joint_names[j] for j in stray[:3])
    return Finding(
        "joints",
        "error",
        f"{len(stray)} of {len(body.joints)} joints are up to {outside.max():.3g} m outside the body",
        names,
        "give joints and vertices in the same unit and pose",
    )


def _floor(body: RiggedBody) -> Finding:
    low = float(body.vertices[:, 1].min())
    if abs(low) <= _FLOAT:
        return Finding("canonical floor", "ok", f"soles at {low:.3f} m")
    return Finding(
        "canonical floor",
        "warning" if abs(low) > _SINK else "note",
        f"the canonical body's lowest vertex is at {low:.2f} m, not at 0",
        rows("vertex", [int(body.vertices[:, 1].argmin())]),
        "put the soles of body, joints and template on the floor together",
    )


def signed_volume(points: np.ndarray, faces: np.ndarray) -> float:
    """Return the volume inside `faces`, negative where they look inwards; unit as that of `points`, cubed."""
    centre = points.mean(axis=0).astype(np.float64)
    a, b, c = (points.astype(np.float64) - centre[None])[faces].transpose(1, 0, 2)
    return float(np.einsum("fx,fx->", a, np.cross(b, c)) / 6)


def _surface(body: RiggedBody) -> list[Finding]:
    rim, used = boundary_edges(body.faces), np.zeros(len(body.vertices), bool)
    used[body.faces] = True
    found = [Finding("body surface", "ok", "closed" if not len(rim) else "closed but for holes")]
    if signed_volume(body.vertices, body.faces) < 0:
        found = [
            Finding(
                "body surface",
                "error",
                "the body's faces look inwards",
                remedy="flip its normals: cloth would be pushed into it",
            )
        ]
    if len(rim):
        found.append(
            Finding(
                "body holes",
                "note",
                f"{len(rim)} edges have one face",
                rows("vertex", rim[0]),
                "penetration is found by the closed part: give a collider if cloth touches there",
            )
        )
    if not used.all():
        lone = np.flatnonzero(~used)
        found.append(Finding("body vertices", "note", f"{len(lone)} belong to no face", rows("vertex", lone)))
    return found
