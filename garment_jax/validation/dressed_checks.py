"""Is the garment on the body, outside of it, the right way round? The template and single frames."""

import numpy as np
from scipy.spatial import KDTree

from garment_jax.body.frame_windows import stretches
from garment_jax.body.kinematics import collider_points, joint_positions, pose_body
from garment_jax.geometry.winding_number import winding_number
from garment_jax.importers.finding import Finding, rows
from garment_jax.validation.raw_clip import RawClip

FAR = 0.15  # metres: the nearest twentieth of a garment's vertices is nearer to the body
INSIDE, MANY = 0.005, 0.1  # of the vertices
DEEP = 0.02  # metres
_TESTED = 300  # vertices at most whose winding number is computed: a thousand triangles each
_MARGIN = 1e-3  # metres that a vertex may be inside: cloth lies on skin
_SIDE = 0.3  # mean of +1 and -1 over the faces, for them to look outwards or inwards
_AIR = 0.4  # metres between the lowest joint and the floor, in the median


def check_dressed(clip: RawClip, *, cloth: bool) -> list[Finding]:
    """Return the findings on template, body and frame 0; metres, Y up. `cloth`: the frames are sound."""
    garment, body = clip.scene.garment, clip.scene.body
    found = [_on_body(garment.template, body.vertices, "template on body", "", "template and body")]
    apart = found[0].severity == "error"
    side = 0.0 if apart else outwardness(garment.template, garment.faces, body.vertices)
    if not apart:
        found.append(_sides(side))
    found.append(_floor(clip))
    if not (cloth and clip.moves_cloth) or apart:
        return found
    V, posed = clip.read(0, 1)[0], pose_body(body, clip.motion, slice(0, 1))[0]
    if not np.isfinite(V).all():
        return found
    place = f"frame {clip.first}"
    found.append(_on_body(V, posed, "garment on body", place, "the frames and the motion"))
    if found[-1].severity == "error":
        return found
    found.append(_mirrored(side, outwardness(V, garment.faces, posed), place))
    inside = _inside(clip, V, posed, place)
    if inside.severity == "error":  # which side looks at the body says nothing in there
        found = [finding for finding in found if finding.check not in ("template side", "mirrored")]
    return [*found, inside]


def outwardness(points: np.ndarray, faces: np.ndarray, body: np.ndarray) -> float:
    """Return whether faces look away from the nearest body vertex: 1 if all do, -1 if none does."""
    a, b, c = points.astype(np.float64)[faces].transpose(1, 0, 2)
    centre = (a + b + c) / 3
    away = centre - body[KDTree(body).query(centre)[1]]
    return float(np.sign((np.cross(b - a, c - a) * away).sum(axis=1)).mean())


def _on_body(points: np.ndarray, body: np.ndarray, check: str, where: str, what: str) -> Finding:
    near = float(np.percentile(KDTree(body).query(points)[0], 5))
    if near <= FAR:
        return Finding(check, "ok", f"the nearest vertices are {100 * near:.1f} cm from the body")
    return Finding(
        check,
        "error",
        f"19 in 20 garment vertices are {near:.2f} m or more from the body",
        where,
        f"give {what} the same unit, up axis and origin, of the same clip and body",
    )


def _sides(side: float) -> Finding:
    if side > -_SIDE:
        return Finding("template side", "ok", "outside out")
    return Finding(
        "template side",
        "note",
        "the template's faces look at the body",
        remedy="only shading depends on it; flip the normals where the garment is made if that looks wrong",
    )


def _mirrored(template: float, frame: float, where: str) -> Finding:
    if template * frame > 0 or min(abs(template), abs(frame)) < _SIDE:
        return Finding("mirrored", "ok", "no")
    return Finding(
        "mirrored",
        "error",
        "the template's faces look to one side of the cloth, the frames' to the other",
        where,
        "the frames are mirrored (an axis negated or two swapped), or the faces turned over: convert again",
    )


def _floor(clip: RawClip) -> Finding:
    R, root = clip.motion.rotations, clip.motion.root
    low = np.concatenate(
        [joint_positions(R[k], root[k], clip.scene.body)[..., 1].min(axis=1) for _, k in stretches(len(root))]
    )
    above = float(
        np.median(low) - (clip.scene.body.joints[:, 1].min() - clip.scene.body.vertices[:, 1].min())
    )
    if abs(above) <= _AIR:
        return Finding("floor", "ok", f"feet {100 * above:.0f} cm above it in the median")
    return Finding(
        "floor",
        "note",
        f"the feet are {abs(above):.2f} m {'above' if above > 0 else 'below'} the floor in the median",
        remedy="fine for cloth alone; lift the motion to the floor if there is one",
    )


def _inside(clip: RawClip, V: np.ndarray, posed: np.ndarray, where: str) -> Finding:
    """Vertices behind the nearest vertex' normal are candidates; the winding number decides."""
    scene = clip.scene
    points, faces = posed, scene.body.faces
    if scene.collider is not None:
        points, faces = collider_points(scene.collider, posed), scene.collider.faces
    distance, nearest = KDTree(points).query(V)
    behind = ((V - points[nearest]) * _normals(points, faces)[nearest]).sum(axis=1) < -_MARGIN
    candidates = np.flatnonzero(behind)
    tested = candidates[:: max(1, -(-len(candidates) // _TESTED))]
    within = tested[winding_number(V[tested], points, faces) > 0.5] if len(tested) else tested
    share = len(candidates) * len(within) / max(len(tested), 1) / len(V)
    deepest = float(distance[within].max(initial=0.0))
    said = f"{100 * share:.2g} % of the vertices are inside, up to about {100 * deepest:.1f} cm deep"
    if not len(within):
        return Finding("garment in body", "ok", "outside in the first frame")
    severity = "error" if share > MANY else "warning" if share > INSIDE or deepest > DEEP else "note"
    return Finding(
        "garment in body",
        severity,
        said,
        f"{where}, {rows('vertex', within)}",
        "simulate from a pose with the garment outside; arms that may pass through need a collider",
    )


def _normals(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the vertices' normals `[q, 3]`, weighted by area; zero for a vertex without a face."""
    a, b, c = points.astype(np.float64)[faces].transpose(1, 0, 2)
    normal, total = np.cross(b - a, c - a), np.zeros((len(points), 3))
    for k in range(3):
        np.add.at(total, faces[:, k], normal)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.where(length > 0, length, 1.0)
