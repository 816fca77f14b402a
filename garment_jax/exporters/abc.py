"""Alembic, written by Blender from a point cache (`io/formats/alembic.py`)."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from garment_jax.exporters.clip import ExportClip
from garment_jax.io.formats.alembic import AlembicMesh, write_alembic
from garment_jax.io.formats.blender import find_blender
from garment_jax.io.formats.pc2 import write_pc2
from garment_jax.storage.scratch import scratch
from garment_jax.storage.whole import written_whole


def export_abc(clip: ExportClip, out: Path, *, blender: str | Path | None = None) -> list[Path]:
    """Write an Alembic file of the objects Garment and Body; return the file. Needs Blender."""
    if clip.first_frame < 0:
        raise ValueError(f"--frame-offset {clip.first_frame}: Blender begins at frame 0; give 0 or more.")
    program = find_blender(blender)
    garment, body = clip.garment, clip.body
    with written_whole(out) as (path,), scratch(out.parent) as folder:
        meshes = [_mesh(clip, "Garment", garment.faces, (garment.uv, garment.faces_uv), folder)]
        _write_points(clip, clip.garment_windows(), len(garment.template), meshes[0].cache)
        if clip.with_body:
            meshes.append(_mesh(clip, "Body", body.faces, (None, None), folder))
            _write_points(clip, clip.body_windows(), len(body.vertices), meshes[1].cache)
        write_alembic(
            path,
            meshes,
            fps=clip.fps,
            first_frame=clip.first_frame,
            count=clip.frames,
            folder=folder,
            blender=program,
        )
    return [out]


def _mesh(
    clip: ExportClip,
    name: str,
    faces: np.ndarray,
    texture: tuple[np.ndarray | None, np.ndarray | None],
    folder: Path,
) -> AlembicMesh:
    rest = clip.garment.template if name == "Garment" else clip.body.vertices
    return AlembicMesh(name, _blender_axes(clip.place(rest)), faces, *texture, folder / f"{name}.pc2")


def _write_points(clip: ExportClip, windows: Iterable[np.ndarray], points: int, cache: Path) -> None:
    write_pc2(cache, map(_blender_axes, windows), clip.frames, points)


def _blender_axes(points: np.ndarray) -> np.ndarray:
    """Return what Blender turns into `points` `[..., 3]` when it writes Alembic."""
    return np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1)
