"""A folder of OBJ files, one a frame, the body's in a folder of their own below it."""

import filecmp
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from garment_jax.exporters.clip import ExportClip
from garment_jax.io.formats.obj import obj_faces, write_obj
from garment_jax.storage.scratch import scratch
from garment_jax.storage.whole import written_whole


def export_obj(clip: ExportClip, out: Path) -> list[Path]:
    """Write `out/garment_0000.obj` … and `out/body/body_0000.obj` …; return the folder.

    A folder that holds these very files stays: a run that was killed after its last file has made it.
    Raises `OSError` for one that holds others.
    """
    if clip.first_frame < 0:
        raise ValueError(f"--frame-offset {clip.first_frame}: files are numbered from 0; give 0 or more.")
    if out.is_file():
        raise ValueError(f"--out {out} is a file; OBJ files, one a frame, fill a folder, name a new one.")
    if _files_in(out) == _files_of(clip):
        with scratch(out.parent) as place:
            _write_folder(place / out.name, clip)
            if not all(filecmp.cmp(place / out.name / name, out / name, False) for name in _files_of(clip)):
                raise OSError(f"{out} is a folder that is not empty; name a new one.")
        return [out]
    with written_whole(out) as (folder,):
        _write_folder(folder, clip)
    return [out]


def _files_of(clip: ExportClip) -> set[Path]:
    numbers = range(clip.first_frame, clip.first_frame + clip.frames)
    names = {Path(f"garment_{number:04d}.obj") for number in numbers}
    return names | {Path(f"body/body_{number:04d}.obj") for number in numbers if clip.with_body}


def _files_in(folder: Path) -> set[Path]:
    return {path.relative_to(folder) for path in folder.rglob("*") if not path.is_dir()}


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
