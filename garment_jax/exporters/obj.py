"""A folder of OBJ files, one a frame, the body's in a folder of their own below it."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from garment_jax.exporters.clip import ExportClip
from garment_jax.io.formats.obj import obj_faces, write_obj
from garment_jax.storage.whole import written_whole


def export_obj(clip: ExportClip, out: Path) -> list[Path]:
    """Write `out/garment_0000.obj` … and `out/body/body_0000.obj` …; return the folder.

    A folder of frames that is there is replaced as a whole.
    """
    if clip.first_frame < 0:
        raise ValueError(f"--frame-offset {clip.first_frame}: files are numbered from 0; give 0 or more.")
    with written_whole(out, folders=True) as (folder,):
        _write_folder(folder, clip)
    return [out]


def _write_folder(folder: Path, clip: ExportClip) -> None:
    garment = clip.garment
    folder.mkdir()
    tail = obj_faces(garment.faces, garment.uv, garment.faces_uv)
    _write_frames(folder, "garment", clip.garment_windows(), tail, clip.first_frame)
    if clip.with_body:
        (folder / "body").mkdir()
        tail = obj_faces(clip.body.faces)
        _write_frames(folder / "body", "body", clip.body_windows(), tail, clip.first_frame)


def _write_frames(folder: Path, name: str, windows: Iterable[np.ndarray], tail: str, number: int) -> None:
    for vertices in windows:
        for frame in vertices:
            write_obj(folder / f"{name}_{number:04d}.obj", frame, tail)
            number += 1
