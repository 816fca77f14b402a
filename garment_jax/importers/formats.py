"""The clips that paths of a format hold, as sources to import."""

from collections.abc import Callable, Sequence
from pathlib import Path

from garment_jax.importers.kinds import list_clips
from garment_jax.importers.mesh_clips import mesh_sources
from garment_jax.importers.motion_clips import motion_sources
from garment_jax.importers.sources import Options, Source
from garment_jax.importers.virtual_bones_clips import virtual_bones_sources
from garment_jax.importers.vto_clips import vto_sources

_LISTERS: dict[str, Callable[[Sequence[Path], Options], list[Source]]] = {
    "vto": vto_sources,
    "virtualbones": virtual_bones_sources,
    "meshes": mesh_sources,
    "motion": motion_sources,
}


def list_sources(paths: Sequence[Path], kind: str, options: Options) -> list[Source]:
    """Return the clips of a `kind` (one of `kinds.KINDS` but "packed") in `paths`; nothing is read yet.

    Raises `FileNotFoundError` where there are none and `ValueError` for a part that is missing, with the
    option that names it.
    """
    return _LISTERS[kind](list_clips(paths, kind), options)
