"""Clips of the vto-dataset: a garment on SMPL, one pickle a clip, the template beside the folder of them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from garment_jax.body.rates import check_lengths, shared_rate
from garment_jax.importers.mesh_clips import check_count, check_vertex_order, placed_windows
from garment_jax.importers.own_files import Wardrobe, check_with_cloth, of_one_file, settle_place
from garment_jax.importers.sources import ForeignClip, Options, Source
from garment_jax.io.formats.vto import VtoClip, read_vto
from garment_jax.io.obj import read_garment
from garment_jax.structs import Garment

_STEADY = 1e-5  # by which a shape may change in a clip


def vto_sources(paths: Sequence[Path], options: Options) -> list[Source]:
    """Return the clips at `paths`, each on a body of its own shape.

    The template is `--garment`, or the only OBJ in the folder above the clips'; its UVs are in metres and
    scaled into 0 … 1. Raises `ValueError` without a body and `FileNotFoundError` without a template.
    """
    check_with_cloth(options, paths[0], own_motion=True)
    options = of_one_file(options, ("clip", "motion"), paths[0])
    garment = options.garment or find_template(paths[0])
    fit = options.fit_uv or (not options.unwrap and _beyond(garment))
    wardrobe = Wardrobe(options._replace(garment=garment, fit_uv=fit))

    def source(path: Path) -> Source:
        return Source(path.stem, path, (path, *wardrobe.files()), lambda: _read(path, wardrobe))

    return [source(path) for path in paths]


def find_template(clip: Path) -> Path:
    """Return the OBJ file in the folder above a clip's, or in its own; `FileNotFoundError` without one."""
    for folder in (clip.resolve().parent.parent, clip.resolve().parent):
        found = [path for path in folder.iterdir() if path.suffix.lower() == ".obj"]
        named = [path for path in found if path.stem == folder.name]
        if named or len(found) == 1:
            return (named or found)[0]
    raise FileNotFoundError(f"{clip}: its garment's template is not there; name the OBJ file with --garment.")


def _beyond(garment: Path) -> bool:
    """Return whether a template's UVs leave 0 … 1."""
    uv = read_garment(garment, uv_required=False).uv
    return bool(len(uv) and (uv.min() < 0 or uv.max() > 1))


def _read(path: Path, wardrobe: Wardrobe) -> ForeignClip:
    clip = read_vto(path)
    o, said = wardrobe.options, clip.motion
    fps = shared_rate(said.fps, o.fps, o.source_fps, path, usual=said.usual_fps)
    betas = _shape(clip, path)
    dressed = wardrobe.dressed(betas)
    garment = dressed.scene.garment
    check_count(clip.vertices.shape[1], garment, path, wardrobe.garment_path)
    check_faces(clip.faces, garment, path, wardrobe.garment_path)
    place = settle_place(
        wardrobe.options, "clip", clip.vertices[0], path, unit=clip.motion.unit, up=clip.motion.up
    )
    check_vertex_order(place(clip.vertices[:1])[0], garment, path, wardrobe.garment_path)
    motion, said = wardrobe.motion(path, betas, fps=fps, source_fps=fps)
    check_lengths(len(clip.vertices), len(motion.root), motion.fps, path, path)
    notes = (*dressed.notes, *said)
    return ForeignClip(dressed.scene, motion, lambda size: placed_windows(clip.vertices, place, size), notes)


def _shape(clip: VtoClip, path: Path) -> np.ndarray | None:
    """Return the body's shape `[k]`, None for the mean shape."""
    if np.abs(clip.betas - clip.betas[:1]).max() > _STEADY:
        frame = int(np.abs(clip.betas - clip.betas[:1]).max(axis=1).argmax())
        raise ValueError(f"{path}: the body's shape changes until frame {frame}; cut the clip by shapes.")
    return clip.betas[0] if clip.betas[0].any() else None


def check_faces(faces: np.ndarray, garment: Garment, path: Path, garment_path: Path) -> None:
    """Raise `ValueError` unless `faces` `[f, 3]` are the garment's, in any order."""
    given, own = [np.unique(np.sort(f, axis=1), axis=0) for f in (faces, garment.faces)]
    if not np.array_equal(given, own):
        raise ValueError(
            f"{path}: its {len(faces)} faces are not those of {garment_path} ({len(garment.faces)}); name "
            "the template of this garment."
        )
