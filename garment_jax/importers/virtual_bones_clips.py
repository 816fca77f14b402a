"""Clips of the VirtualBones data: a garment on SMPL-H, one archive a clip, the template beside them."""

from collections.abc import Sequence
from pathlib import Path

from garment_jax.body.rates import check_lengths, shared_rate
from garment_jax.importers.mesh_clips import check_count, check_vertex_order, placed_windows
from garment_jax.importers.own_files import Wardrobe, check_with_cloth, of_one_file, settle_place
from garment_jax.importers.sources import ForeignClip, Options, Source
from garment_jax.io.formats.virtual_bones import read_virtual_bones


def virtual_bones_sources(paths: Sequence[Path], options: Options) -> list[Source]:
    """Return the clips at `paths`, named by their folders too: each dress counts from 1.

    The template is `--garment`, or `template.obj` beside the clips. Raises `ValueError` without a body: the
    data has none, and a sequence file needs one.
    """
    if options.body is None:
        raise ValueError(f"{paths[0]}: the data has no body, only its poses; name a SMPL-H body with --body.")
    check_with_cloth(options, paths[0], own_motion=True)
    options = of_one_file(options, ("clip", "motion"), paths[0])
    garment = options.garment or paths[0].parent / "template.obj"
    wardrobe = Wardrobe(options._replace(garment=garment))

    def source(path: Path) -> Source:
        name = f"{path.resolve().parent.name}_{path.stem}"
        return Source(name, path, (path, *wardrobe.files()), lambda: _read(path, wardrobe))

    return [source(path) for path in paths]


def _read(path: Path, wardrobe: Wardrobe) -> ForeignClip:
    clip = read_virtual_bones(path)
    dressed = wardrobe.dressed()
    garment = dressed.scene.garment
    check_count(clip.vertices.shape[1], garment, path, wardrobe.garment_path)
    place = settle_place(wardrobe.options, "clip", clip.vertices[0], path, up=clip.motion.up)
    check_vertex_order(place(clip.vertices[:1])[0], garment, path, wardrobe.garment_path)
    o, stated = wardrobe.options, clip.motion.fps
    fps = shared_rate(stated, o.fps, o.source_fps, path, usual=None)
    motion, said = wardrobe.motion(path, fps=fps, source_fps=fps)
    check_lengths(len(clip.vertices), len(motion.root), motion.fps, path, path)
    notes = (*dressed.notes, *place.notes, *(note for note in said if "the garment" not in note))
    return ForeignClip(dressed.scene, motion, lambda size: placed_windows(clip.vertices, place, size), notes)
