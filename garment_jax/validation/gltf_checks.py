"""Checks on glTF files: the body that is in them, or the motion where they hold nothing else."""

from pathlib import Path

import numpy as np

from garment_jax.importers.finding import Finding
from garment_jax.io.formats.gltf import GltfAnimation, read_animation
from garment_jax.validation.body_checks import likely_units
from garment_jax.validation.track_checks import check_track


def check_animation(
    path: Path, *, fps: float | None = None, name: str | None = None, skeleton: str | None = None
) -> list[Finding]:
    """Return the findings on a motion without a body, as `import` samples it; raises as `read_animation`."""
    moved = read_animation(path, name=name, fps=None, source_fps=fps, skeleton=skeleton)
    size = float(np.ptp(moved.rest, axis=0).max())
    units = " or ".join(likely_units(size)) or "an unknown unit"
    found = [Finding("skeleton unit", "ok", f"{size:.4g} m large in its rest pose ({units})")]
    found += [Finding("skeleton", "note", note) for note in moved.notes]
    return [*found, *check_track(_positions(moved), moved.fps)]


def _positions(moved: GltfAnimation) -> np.ndarray:
    """Return the joints' places `[t, j, 3]`, metres."""
    points = np.zeros((*moved.rotations.shape[:2], 3))
    points[:, 0] = moved.root
    for j in range(1, len(moved.parents)):
        parent = int(moved.parents[j])
        bone = moved.rest[j] - moved.rest[parent]
        points[:, j] = points[:, parent] + moved.rotations[:, parent].astype(np.float64) @ bone
    return points
