"""A body known only as vertices: its rest mesh and a cache of it moving become a rigged body and a motion."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.body.fitted_rig import JOINTS, FittedRig, rig_from_vertices
from garment_jax.body.rates import body_rate
from garment_jax.geometry.topology import unique_edges
from garment_jax.importers.units import Unit, metres_per_unit, settle_unit, to_metres_y_up
from garment_jax.io.formats.any_mesh_cache import read_cache
from garment_jax.io.formats.mesh_cache import MeshCache
from garment_jax.io.formats.obj import read_obj
from garment_jax.io.validation import check_size
from garment_jax.structs import RiggedBody

MOST_RESIDUAL = 1.0  # cm in the mean over vertices and frames; more, and the cloth's body is another one
_LYING = 60.0  # degrees of the root's mean tilt that suggest another up axis
_STANDING = 30.0  # degrees of it that are somebody's who stands and walks
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
    rest_unit: float | str | None = None,
    rest_up: str | None = None,
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

    `unit` ("cm", "m", … or metres per unit) and `up` ("Y" or "Z") are the cache's, without them its own;
    `rest_unit` and `rest_up` the rest mesh's. What one of the two does not say is as in the other, where the
    edges are as long and the body then stands; else metres and Y, said in the note, for a body's size.
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
    ratio = _edges_as_long(body.vertices, body.faces, moving, rest, cache)
    taken, metres = _units(body.vertices, ratio, rest, cache, unit, moving.unit, rest_unit)
    axis = up or moving.up or rest_up or "Y"
    frames = _Converted(moving.vertices, metres, axis)

    def fit(rest_axis: str) -> FittedRig:
        points = to_metres_y_up(body.vertices, taken.metres, rest_axis)
        check_size(points, f"the body {rest}")
        return rig_from_vertices(body.faces, frames, points, fps=rate, joints=joints, rig=rig, seed=seed)

    notes = [taken.note] if taken.note else []
    if up is None and moving.up is None and rest_up is None:
        notes.append(f"{cache} does not say its up axis: Y is taken")
    other = "Y" if axis == "Z" else "Z"
    if rig is not None and rest_up is None:  # the one that the rest mesh had when the rig was fitted
        lies = not np.allclose(rig.vertices, to_metres_y_up(body.vertices, taken.metres, axis), atol=1e-4)
        fitted = fit(other if lies else axis)
    else:
        fitted = fit(rest_up or axis)
        if rest_up is None and _tilt(fitted) > _LYING and (up or moving.up):
            turned = fit(other)
            if _tilt(turned) < _STANDING:
                fitted = turned
                notes.append(f"{rest} stands along {other} and {cache} along {axis}: each taken so")
    residual = fitted.residual_cm
    if most_residual is not None and residual.mean > most_residual:
        raise ValueError(
            f"{cache}: {len(fitted.body.joints)} joints follow the body to {residual}, more than "
            f"{most_residual:g} cm in the mean; ask for more joints, or allow it."
        )
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


def _units(
    points: np.ndarray,
    ratio: float,
    rest: str | Path,
    cache: str | Path,
    unit: float | str | None,
    stated: float | None,
    rest_unit: float | str | None,
) -> tuple[Unit, float]:
    """Return the rest mesh's unit and the cache's metres per unit; `ratio`: the cache's edges over its edges.

    Raises `ValueError` where the two are of different size in these.
    """
    size, alike = float(np.ptp(points, axis=0).max()), abs(ratio - 1) <= _SAME_LENGTH
    moves = stated if unit is None else metres_per_unit(unit, "--motion-unit")
    taken = settle_unit(moves if alike else None, rest_unit, size, f"the body {rest}", "--body-unit")
    metres = taken.metres if moves is None else moves
    if abs(ratio * metres / taken.metres - 1) > _SAME_LENGTH:
        raise ValueError(
            f"the edges of {cache} are {ratio * metres / taken.metres:.3g} times as long as those of {rest}; "
            "export both with one vertex order, or give the unit of each (--body-unit, --motion-unit)."
        )
    return taken, metres


def _edges_as_long(
    points: np.ndarray, faces: np.ndarray, moving: MeshCache, rest: str | Path, cache: str | Path
) -> float:
    """Return the length of frame 0's edges over those of the rest mesh, as the numbers stand.

    Raises `ValueError` unless it has the rest mesh's vertices.
    """
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
    return float(np.median(lengths[1]) / max(float(np.median(lengths[0])), 1e-12))


def _tilt(fitted: FittedRig) -> float:
    """Return the root's mean tilt in degrees."""
    return float(np.degrees(np.arccos(np.clip(fitted.motion.rotations[:, 0, 1, 1], -1.0, 1.0)).mean()))


def _lying(fitted: FittedRig, cache: str | Path) -> list[str]:
    """Return a sentence where the body lies all the time, which another up axis would explain."""
    tilt = _tilt(fitted)
    if tilt < _LYING:
        return []
    return [f"{cache}: the root is tilted by {tilt:.0f} degrees in the mean; check the up axis"]
