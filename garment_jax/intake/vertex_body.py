"""A body known only as vertices: its rest mesh and a cache of it moving become a rigged body and a motion."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.body.fitted_rig import JOINTS, FittedRig, rig_from_vertices
from garment_jax.body.rates import body_rate
from garment_jax.data.validation import check_size
from garment_jax.formats.mesh_cache import MeshCache, read_cache
from garment_jax.formats.obj import read_obj
from garment_jax.geometry.topology import unique_edges
from garment_jax.intake.units import settle_unit, to_metres_y_up
from garment_jax.structs import RiggedBody

MOST_RESIDUAL = 1.0  # cm in the mean over vertices and frames; more, and the cloth's body is another one
_LYING = 60.0  # degrees of the root's mean tilt that suggest another up axis
_SAME_LENGTH = 0.1  # relative difference of edges beyond which two meshes have another unit


class VertexBody(NamedTuple):
    """What was read, and what the user is to know."""

    fitted: FittedRig
    notes: tuple[str, ...]  # how well the rig fits, and what was decided for the user, a sentence each


def read_vertex_body(
    rest: str | Path,
    cache: str | Path,
    *,
    unit: float | str | None = None,
    up: str | None = None,
    fps: float | None = None,
    scene_fps: float | None = None,
    source_fps: float | None = None,
    joints: int = JOINTS,
    rig: RiggedBody | None = None,
    mesh: str | None = None,
    most_residual: float | None = MOST_RESIDUAL,
    seed: int = 0,
) -> VertexBody:
    """Read the OBJ mesh `rest` (canonical pose, facing +Z) and its motion `cache`; fit a rig to both.

    `unit` ("cm", "m", … or metres per unit) and `up` ("Y" or "Z") are those of both files; without them the
    cache's own, and metres and Y, said in the note, where it does not say and the mesh has a body's size.
    `mesh`: the one to take of a cache that holds several. `fps` is its cloth's rate, `scene_fps` and
    `source_fps` are the user's (`body.rates.body_rate`). `rig` is a body fitted before, whose motion
    alone is sought. Raises `FileNotFoundError`, `OSError`, or `ValueError` for what does not fit or for a
    mean residual above `most_residual` cm (None allows any).
    """
    body, moving = read_obj(rest), read_cache(cache, mesh=mesh, option="--motion-mesh")
    rate = body_rate(
        moving.fps,
        Path(cache),
        clip=fps,
        scene_fps=scene_fps,
        source_fps=source_fps,
        frames_a_sample=moving.frames_a_sample,
    )
    _check_same_mesh(body.vertices, body.faces, moving, rest, cache)
    size = float(np.ptp(body.vertices, axis=0).max())
    taken, axis = settle_unit(moving.unit, unit, size, f"the body {rest}"), up or moving.up or "Y"
    points = to_metres_y_up(body.vertices, taken.metres, axis)
    check_size(points, f"the body {rest}")
    frames = _Converted(moving.vertices, taken.metres, axis)
    fitted = rig_from_vertices(body.faces, frames, points, fps=rate, joints=joints, rig=rig, seed=seed)
    residual = fitted.residual_cm
    if most_residual is not None and residual.mean > most_residual:
        raise ValueError(
            f"{cache}: {len(fitted.body.joints)} joints follow the body to {residual}, more than "
            f"{most_residual:g} cm in the mean; ask for more joints, or allow it."
        )
    notes = [taken.note] if taken.note else []
    if up is None and moving.up is None:
        notes.append(f"{cache} does not say its up axis: Y is taken")
    notes += _lying(fitted, cache)
    return VertexBody(
        fitted, (f"{cache}: {len(fitted.body.joints)} joints follow the body to {residual}", *notes)
    )


class _Converted:
    """A cache's vertices as metres, Y up, converted when they are sliced by frames."""

    def __init__(self, vertices: Any, scale: float, up: str) -> None:
        self.shape = tuple(vertices.shape)
        self._vertices, self._scale, self._up = vertices, scale, up

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, frames: slice) -> np.ndarray:
        return to_metres_y_up(np.asarray(self._vertices[frames], np.float32), self._scale, self._up)


def _check_same_mesh(
    points: np.ndarray, faces: np.ndarray, moving: MeshCache, rest: str | Path, cache: str | Path
) -> None:
    """Raise `ValueError` unless frame 0 has the rest mesh's vertices, by number and lengths of edges."""
    if not len(faces):
        raise ValueError(f"{rest} holds no faces; export the body's mesh, not its points.")
    if moving.vertices.shape[1] != len(points):
        raise ValueError(
            f"{cache} has {moving.vertices.shape[1]} vertices and {rest} {len(points)}; export both from one "
            "mesh with its vertex order."
        )
    edges = unique_edges(faces)
    first = np.asarray(moving.vertices[0:1], np.float64)[0]
    if not np.isfinite(first).all():
        raise ValueError(f"{cache}: frame 0 holds values that are not finite; export the clip again.")
    lengths = [np.linalg.norm(p[edges[:, 0]] - p[edges[:, 1]], axis=1) for p in (points, first)]
    ratio = float(np.median(lengths[1]) / max(float(np.median(lengths[0])), 1e-12))
    if abs(ratio - 1) > _SAME_LENGTH:
        raise ValueError(
            f"the edges of {cache} are {ratio:.3g} times as long as those of {rest}; export both in one unit "
            "and with one vertex order."
        )


def _lying(fitted: FittedRig, cache: str | Path) -> list[str]:
    """Return a sentence where the body lies all the time, which another up axis would explain."""
    tilt = np.degrees(np.arccos(np.clip(fitted.motion.rotations[:, 0, 1, 1], -1.0, 1.0)).mean())
    if tilt < _LYING:
        return []
    return [f"{cache}: the root is tilted by {tilt:.0f} degrees in the mean; check the up axis"]
