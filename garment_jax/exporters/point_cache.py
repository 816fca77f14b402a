"""A point cache with the mesh it moves: two files a mesh, the same vertices in the same order."""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from garment_jax.exporters.cache_files import cache_files
from garment_jax.exporters.clip import ExportClip
from garment_jax.io.formats.obj import obj_faces, write_obj
from garment_jax.storage.whole import written_whole

Write = Callable[[Path, Iterable[np.ndarray], int, int], None]  # path, windows, frames, points


def export_cache(clip: ExportClip, out: Path, write: Write) -> list[Path]:
    """Write `out` and the matching OBJ beside it, and both again as `NAME_body` for the body.

    The OBJ is the garment's template on the canonical body (the body's canonical pose): what cloth tools
    call the rest shape. Returns the files.
    """
    files = cache_files(out, body=clip.with_body)
    garment = clip.garment
    with written_whole(*files, last=files[::2]) as temporary:
        write(temporary[0], clip.garment_windows(), clip.frames, len(garment.template))
        faces = obj_faces(garment.faces, garment.uv, garment.faces_uv)
        write_obj(temporary[1], clip.place(garment.template), faces)
        if clip.with_body:
            write(temporary[2], clip.body_windows(), clip.frames, len(clip.body.vertices))
            write_obj(temporary[3], clip.place(clip.body.vertices), obj_faces(clip.body.faces))
    return files
