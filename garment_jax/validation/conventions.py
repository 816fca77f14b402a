"""Which unit, which up axis, which frame rate does a clip have, by what it says and by what it shows?"""

import numpy as np

from garment_jax.body.up_axis import axis_name
from garment_jax.geometry.topology import unique_edges
from garment_jax.importers.finding import Finding, Repair
from garment_jax.validation.body_checks import LARGEST, PERSON, SMALLEST, UNITS, body_unit, body_up, extent
from garment_jax.validation.raw_clip import RawClip

_NAMES = {
    "metre": "m",
    "metres": "m",
    "centimetres": "cm",
    "millimetres": "mm",
    "inch": "inches",
    "in": "inches",
}
_SAME = 0.06  # relative: a ratio this near 100 or 1000 is that of a unit, cloth stretches less
_TILTED = 0.8  # cosine between the root's mean up direction and an axis, for it to be that axis
_HEIGHT = (0.4, 1.6)  # of the canonical root's height: a root that is there in the median stands upright


def settle_conventions(clip: RawClip) -> list[Finding]:
    """Return the findings on unit, up axis and fps; the clip is repaired where there is no doubt."""
    found = [_fps(clip), _unit(clip)]
    if found[-1].repair is not None:
        clip.repair(found[-1].repair)
    for check in (_up, _root_unit, _frames_unit):
        found.append(check(clip))
        if found[-1].repair is not None:
            clip.repair(found[-1].repair)
    return found


def scale_of(ratio: float) -> str | None:
    """Return the unit whose length `ratio` is, "cm" for about 100, or None."""
    near = [unit for unit in ("cm", "mm") if abs(ratio / UNITS[unit] - 1) < _SAME]
    return near[0] if near else None


def _fps(clip: RawClip) -> Finding:
    if clip.fps is not None:
        return Finding("frame rate", "ok", f"{clip.fps:g} frames a second")
    said = clip.attributes.get("fps")
    return Finding(
        "frame rate",
        "error",
        "attribute fps is missing" if said is None else f"fps is {said!r}",
        remedy="set it to the clip's true frame rate (--fix --fps RATE does)",
    )


def _unit(clip: RawClip) -> Finding:
    said = clip.attributes.get("length_unit")
    shown, size = body_unit(clip.scene.body), extent(clip.scene.body.vertices)
    garment = extent(clip.scene.garment.template)
    if said == "m":
        if shown.repair is not None:
            scaled = garment * shown.repair.amount
            return shown if SMALLEST <= scaled <= LARGEST else shown._replace(repair=None)
        return shown if shown.severity == "error" else _garment_unit(garment, shown)
    unit = _NAMES.get(str(said), str(said))
    meant = "m" if PERSON[0] <= size <= PERSON[1] else unit
    certain = meant in UNITS and PERSON[0] <= size / UNITS[meant] <= PERSON[1]
    certain &= SMALLEST <= garment / UNITS.get(meant, 1.0) <= LARGEST
    return Finding(
        "body unit",
        "error",
        f"attribute length_unit is {said!r} and the body is {size:.4g} large; only metres are read",
        remedy="convert all lengths to metres" + (" (--fix does)" if certain else ""),
        repair=Repair("unit", 1 / UNITS[meant]) if certain else None,
    )


def _garment_unit(size: float, otherwise: Finding) -> Finding:
    if SMALLEST <= size <= LARGEST:
        return otherwise
    return Finding(
        "garment unit",
        "error",
        f"the template is {size:.4g} m large, the body's unit is another",
        remedy="give template and body in the same unit, metres",
    )


def _up(clip: RawClip) -> Finding:
    said, canonical = clip.attributes.get("up_axis"), body_up(clip.scene.body)
    world, standing = _world_up(clip, canonical)
    if canonical == world == "Y":
        if said == "Y":
            lying = _lying_along(clip)
            if lying != "Y":
                value = f"the body lies along {lying} in the mean over the frames"
                return Finding("up axis", "note", value, remedy="fine for somebody who lies on the floor")
            return Finding("up axis", "ok", "Y")
        value, repair = f"attribute up_axis is {said!r}, body and motion stand along Y", Repair("attributes")
    else:
        both = canonical == world
        shown = "body and motion stand" if both else f"the {'body' if canonical == 'Z' else 'motion'} stands"
        shown_axis = world if world != "Y" else canonical
        value = f"{shown} along {shown_axis}" + ("" if said == "Y" else f" (attribute up_axis is {said!r})")
        repair = (
            Repair("up" if both else "canonical up" if canonical == "Z" else "world up")
            if standing and world in "YZ"
            else None
        )
    return Finding(
        "up axis",
        "error",
        value,
        remedy="turn the clip so that Y is up" + (" (--fix does)" if repair is not None else ""),
        repair=repair,
    )


def _world_up(clip: RawClip, canonical: str) -> tuple[str, bool]:
    """Return the world's up axis as the root stands in it, and whether its height agrees.

    Somebody who lies on the floor for a whole clip has a root along Z too, but near Y = 0, and does not move
    up and down by half a body's height while staying where the other axis has it.
    """
    body, axis = clip.scene.body, np.eye(3)["XYZ".index(canonical)]
    up = (clip.motion.rotations[:, 0].astype(np.float64) @ axis).mean(axis=0)
    root = np.median(clip.motion.root, axis=0)
    height = float(body.joints[0] @ axis) - float((body.vertices @ axis).min())
    upright = [bool(_HEIGHT[0] * height < root[k] < _HEIGHT[1] * height) for k in range(3)]
    if up[2] > _TILTED and not (canonical == "Y" and upright[1] and not upright[2]):
        return "Z", upright[2]
    shown = axis_name(up)
    if canonical == "Y" and shown != "Y" and abs(up).max() > _TILTED:
        k, sign = "XYZ".index(shown[-1]), -1.0 if shown[0] == "-" else 1.0
        spread = np.ptp(clip.motion.root, axis=0)
        stands = _HEIGHT[0] * height < sign * root[k] < _HEIGHT[1] * height and not upright[1]
        if stands or (k != 1 and spread[1] > 0.5 * height and spread[k] < 0.5 * spread[1]):
            return shown, False
    return "Y", upright[1]


def _lying_along(clip: RawClip) -> str:
    """Return the axis along which the root is in the mean over the frames; "Y" where that is none clearly."""
    up = clip.motion.rotations[:, 0, :, 1].astype(np.float64).mean(axis=0)
    return axis_name(up) if np.abs(up).max() > _TILTED else "Y"


def _root_unit(clip: RawClip) -> Finding:
    """A motion in centimetres on a body in metres: the root is a hundred times as high."""
    canonical = float(clip.scene.body.joints[0, 1] - clip.scene.body.vertices[:, 1].min())
    height = float(np.median(clip.motion.root[:, 1]))
    for unit in ("cm", "mm"):
        if 0.6 < height / UNITS[unit] / max(canonical, 1e-6) < 1.4:
            return Finding(
                "root unit",
                "error",
                f"the root is {height:.4g} m high, on the canonical body {canonical:.2f}",
                remedy=f"convert the motion from {unit} to metres (--fix does)",
                repair=Repair("root unit", 1 / UNITS[unit]),
            )
    return Finding("root unit", "ok", f"{height:.2f} m high in the median")


def _frames_unit(clip: RawClip) -> Finding:
    """Frames in another unit than the template: all edges are a hundred times as long."""
    if not clip.moves_cloth:
        return Finding("frames unit", "ok", "no garment in the file")
    edges, template = unique_edges(clip.scene.garment.faces), clip.scene.garment.template
    ratio = edge_ratio(clip.read(0, 1)[0], edge_lengths(template, edges), edges)
    finite = ratio[np.isfinite(ratio)]
    middle = float(np.median(finite)) if len(finite) else 1.0
    unit, inverse = scale_of(middle), scale_of(1 / max(middle, 1e-9))
    if unit is None and inverse is None:
        return Finding("frames unit", "ok", f"edges are {middle:.3g} times the template's")
    factor = 1 / UNITS[unit] if unit else UNITS[inverse or "m"]
    return Finding(
        "frames unit",
        "error",
        f"the frames' edges are {middle:.4g} times the template's",
        remedy="convert the frames to the template's unit (--fix does)",
        repair=Repair("frames unit", factor),
    )


def edge_lengths(V: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the lengths `[e]` of edges `[e, 2]` between vertices `[n, 3]`."""
    along = V[edges[:, 0]] - V[edges[:, 1]]
    return np.sqrt(np.einsum("ex,ex->e", along, along))


def edge_ratio(V: np.ndarray, rest: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return each edge's length over that at rest, `[e]`; where `rest` `[e]` is 0, 1."""
    return np.where(rest > 0, edge_lengths(V, edges) / np.where(rest > 0, rest, 1.0), 1.0)
