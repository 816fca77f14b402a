"""A point cache with the mesh it moves: two files a mesh, the same vertices in the same order."""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from garment_jax.exporters.clip import ExportClip
from garment_jax.io.formats.obj import is_our_obj, notes_of, obj_faces, write_obj
from garment_jax.io.overwrite_checks import not_own
from garment_jax.storage.lock import lock_name, locked
from garment_jax.storage.whole import written_whole

Write = Callable[[Path, Iterable[np.ndarray], int, int], None]  # path, windows, frames, points


def export_cache(clip: ExportClip, out: Path, write: Write) -> list[Path]:
    """Write `out` and the matching OBJ beside it, and both again as `NAME_body` for the body.

    The OBJ is the garment's template on the canonical body (the body's canonical pose): what cloth tools
    call the rest shape. Returns the files. Raises `ValueError` where an OBJ of that name is there that no
    export wrote (it may be the garment's source), or a cache that the OBJ beside it does not name; `OSError`
    where another process exports to this name.
    """
    body = out.with_name(f"{out.stem}_body{out.suffix}")
    caches = [out, body] if clip.with_body else [out]
    files = [path for cache in caches for path in (cache, cache.with_suffix(".obj"))]
    for path in files:
        if path.suffix == ".obj" and path.exists() and not is_our_obj(path):
            raise ValueError(
                f"{path} is there and no export wrote it, and the mesh of {out.name} is written to it; name "
                "another --out."
            )
    # of two exports at once that share the mesh's file one would forget the other's cache
    with locked(out.parent, f"exporting {out.stem}", name=lock_name(out.stem), remedy="name another --out"):
        # a cache has no place for who wrote it: the OBJ beside it names those that are ours
        known = {cache: notes_of(cache.with_suffix(".obj")) for cache in caches}
        for cache, names in known.items():
            if cache.exists() and cache.name not in names:
                raise not_own(cache, "export")
        ours = [sorted({*names, cache.name}) for cache, names in known.items()]
        garment = clip.garment
        with written_whole(*files, last=caches) as temporary:
            write(temporary[0], clip.garment_windows(), clip.frames, len(garment.template))
            write_obj(
                temporary[1],
                clip.place(garment.template),
                obj_faces(garment.faces, garment.uv, garment.faces_uv),
                ours[0],
            )
            if clip.with_body:
                write(temporary[2], clip.body_windows(), clip.frames, len(clip.body.vertices))
                write_obj(temporary[3], clip.place(clip.body.vertices), obj_faces(clip.body.faces), ours[1])
    return files
