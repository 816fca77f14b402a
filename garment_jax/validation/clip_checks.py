"""All checks on a sequence file, in the order in which one fault would hide another."""

import numpy as np

from garment_jax.body.frame_windows import stretches
from garment_jax.body.kinematics import joint_positions
from garment_jax.importers.finding import Finding
from garment_jax.importers.mesh_checks import check_mesh
from garment_jax.importers.uv_checks import check_uvs
from garment_jax.validation.body_checks import check_body, check_weights
from garment_jax.validation.cloth_checks import check_cloth
from garment_jax.validation.conventions import settle_conventions
from garment_jax.validation.dressed_checks import check_dressed
from garment_jax.validation.raw_clip import RawClip
from garment_jax.validation.track_checks import check_track

_TURNED = 1e-2  # of R R^T from the identity; as `data.validation`


def check_clip(clip: RawClip, *, warn: bool = True) -> list[Finding]:
    """Return the findings on an open clip; where a repair is safe the clip is repaired on the way.

    Without `warn` the costly checks are left out that never find an error: overlapping UVs, strain, folds.
    """
    found = [*clip.found, *settle_conventions(clip)]
    garment, body = clip.scene.garment, clip.scene.body
    found += check_mesh(garment.template, garment.faces) + check_uvs(garment, layout=warn)
    found += check_body(body) + _pin_weights(clip)
    if any(finding.repair is not None and finding.repair.kind == "weights" for finding in found):
        clip.repair(next(f.repair for f in found if f.repair is not None and f.repair.kind == "weights"))
    turns = _rotations(clip)
    found.append(turns)
    if turns.severity == "error":
        return found
    found += _motion(clip)
    if _has_error(found, "garment unit"):
        return found
    sound = not _has_error(found, "static", "jumps") and clip.moves_cloth and clip.frames > 1
    cloth = check_cloth(clip, warn=warn) if sound else []
    dressed = check_dressed(clip, cloth=sound and not _has_error(cloth, "vertex order", "pins"))
    if _has_error(dressed, "template on body"):  # pins start from the template
        cloth = [finding for finding in cloth if finding.check != "pins"]
    return found + cloth + dressed


def _has_error(findings: list[Finding], *checks: str) -> bool:
    return any(finding.severity == "error" and finding.check in checks for finding in findings)


def _pin_weights(clip: RawClip) -> list[Finding]:
    return [] if clip.scene.pins is None else check_weights(clip.scene.pins.weights, "pin weights")


def _rotations(clip: RawClip) -> Finding:
    wrong = np.zeros(clip.motion.rotations.shape[:2], bool)
    for _, frames in stretches(len(wrong)):  # a long clip's matrices in float64 would fill the memory
        R = clip.motion.rotations[frames].astype(np.float64)
        error = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(axis=(-1, -2))
        wrong[frames] = (error > _TURNED) | (np.linalg.det(R) < 0)
    if not wrong.any():
        return Finding("rotations", "ok", "all are")
    frame, joint = np.argwhere(wrong)[0]
    return Finding(
        "rotations",
        "error",
        f"{int(wrong.sum())} matrices are no rotations",
        f"frame {frame}, joint {clip.scene.body.joint_names[joint]}",
        "export the motion again: scaled, transposed or mirrored joints do not turn a body",
    )


def _motion(clip: RawClip) -> list[Finding]:
    points = joint_positions(clip.motion.rotations, clip.motion.root, clip.scene.body)
    found = check_track(points, clip.fps)
    for finding in found:
        if finding.repair is not None:
            clip.repair(finding.repair)
    return found
