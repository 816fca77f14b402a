"""Clips that are animated meshes of the user's garment: PC2, MDD, USD, Alembic, folders of OBJ or PLY."""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from garment_jax.body.rates import check_lengths, clip_rate
from garment_jax.geometry.topology import unique_edges
from garment_jax.importers.own_files import (
    MESHES,
    Place,
    Wardrobe,
    check_with_cloth,
    is_same,
    list_motions,
    of_one_file,
    settle_place,
)
from garment_jax.importers.sources import ForeignClip, Options, Source
from garment_jax.importers.vertex_body import VertexBody, read_vertex_body
from garment_jax.io.formats.any_mesh_cache import read_cache
from garment_jax.structs import Garment, RiggedBody

Rig = Callable[[], RiggedBody]

_STRETCH = 2.0  # an edge this many times longer or shorter than in the template is another edge
_SHARE = 0.1  # of such edges that no cloth has


def mesh_sources(paths: Sequence[Path], options: Options) -> list[Source]:
    """Return the clips of animated meshes at `paths`, each with the motion of the same name.

    A body that is a mesh (OBJ) moves by the caches among the motions: a rig is fitted to the first of them
    and follows the others. Raises `ValueError` without a garment or a body, or where a clip has no motion or
    several.
    """
    check_with_cloth(options, paths[0])
    motions = pair_motions(paths, list_motions(options))
    for path in paths:
        if options.garment is not None and is_same(options.garment, path):  # a frame of the clip
            options = of_one_file(options, ("clip", "garment"), options.garment)
    wardrobe = Wardrobe(options, motions=motions)
    rig = fitted_once(wardrobe, paths[0], motions[0]) if wardrobe.body_path.suffix.lower() in MESHES else None

    def source(path: Path, motion: Path) -> Source:
        files = (path, motion, *wardrobe.files(), *([motions[0]] if rig else []))
        return Source(
            path.stem, path, tuple(dict.fromkeys(files)), lambda: _read(path, motion, wardrobe, rig)
        )

    return [source(path, motion) for path, motion in zip(paths, motions, strict=True)]


def pair_motions(clips: Sequence[Path], motions: Sequence[Path]) -> list[Path]:
    """Return the motion of each clip: the one of the same stem, or the only one of an only clip.

    NAME_body, as `export` writes the body of NAME, is a motion of NAME where no other is.
    Raises `ValueError` for a clip that has none, or several.
    """
    if len(clips) == len(motions) == 1:
        return list(motions)
    by_stem: dict[str, list[Path]] = {}
    for motion in motions:
        by_stem.setdefault(motion.stem, []).append(motion)
    for clip in clips:
        by_stem.setdefault(clip.stem, by_stem.get(f"{clip.stem}_body", []))
        found = by_stem[clip.stem]
        if len(found) != 1:
            have = ", ".join(sorted({motion.stem for motion in motions}))
            raise ValueError(
                f"{clip} has {len(found)} motions named {clip.stem!r} among {have}; name each motion as its "
                "clip."
            )
    return [by_stem[clip.stem][0] for clip in clips]


def _read(path: Path, motion_path: Path, wardrobe: Wardrobe, rig: Rig | None) -> ForeignClip:
    mesh = read_cache(path, mesh=wardrobe.options.mesh.get("clip"))
    options = wardrobe.options
    if is_same(path, motion_path):  # garment and body are meshes of one file
        options = of_one_file(options, ("clip", "motion"), path)
    fps = clip_rate(mesh.fps, wardrobe.options.fps, path, frames_a_sample=mesh.frames_a_sample)
    moved = None if rig is None else moving_body(wardrobe.body_path, options, motion_path, rig(), fps)
    dressed = wardrobe.dressed(body=None if moved is None else moved.fitted.body)
    check_count(mesh.vertices.shape[1], dressed.scene.garment, path, wardrobe.garment_path)
    place = settle_place(options, "clip", np.asarray(mesh.vertices[0]), path, unit=mesh.unit, up=mesh.up)
    check_vertex_order(place(mesh.vertices[:1])[0], dressed.scene.garment, path, wardrobe.garment_path)
    motion, said = (
        wardrobe.motion(motion_path, fps=fps) if moved is None else (moved.fitted.motion, moved.notes)
    )
    check_lengths(
        len(mesh.vertices), len(motion.root), motion.fps, path, motion_path, stated=mesh.fps is not None
    )
    notes = (*dressed.notes, *(f"{path}: {note}" for note in mesh.notes), *place.notes, *said)
    if fps is None:
        notes += (f"{path} does not say its frame rate: taken for the motion's {motion.fps:g} fps",)
    return ForeignClip(dressed.scene, motion, lambda size: placed_windows(mesh.vertices, place, size), notes)


def fitted_once(wardrobe: Wardrobe, clip: Path, motion: Path) -> Rig:
    """Return a function that gives the rig fitted to a body's first motion, and fits it when first asked."""
    options = wardrobe.options
    if is_same(clip, motion):
        options = of_one_file(options, ("clip", "motion"), clip)
    return cache(lambda: moving_body(wardrobe.body_path, options, motion, None, None).fitted.body)


def moving_body(
    rest: Path, options: Options, motion: Path, rig: RiggedBody | None, fps: float | None
) -> VertexBody:
    """Return the rig and the motion of a body known as vertices, `fps` of its clip; `rig`: fitted before."""
    return read_vertex_body(
        rest,
        motion,
        unit=options.unit.get("motion"),
        up=options.up.get("motion"),
        rest_unit=options.unit.get("body"),
        rest_up=options.up.get("body"),
        fps=fps,
        scene_fps=options.fps,
        source_fps=options.source_fps,
        rig=rig,
        mesh=options.mesh.get("motion"),
    )


def placed_windows(vertices, place: Place, size: int) -> Iterator[np.ndarray]:
    """Yield windows `[k, n, 3]` of `vertices`, metres, Y up, `size` frames at a time."""
    for start in range(0, len(vertices), size):
        yield place(np.asarray(vertices[start : start + size]))


def check_count(count: int, garment: Garment, path: Path, garment_path: Path) -> None:
    """Raise `ValueError` unless a clip has as many vertices as the garment."""
    if count != len(garment.template):
        raise ValueError(
            f"{path} has {count} vertices and {garment_path} {len(garment.template)}; export the clip of "
            "that garment, with its vertex order."
        )


def check_vertex_order(V: np.ndarray, garment: Garment, path: Path, garment_path: Path) -> None:
    """Raise `ValueError` where the frame `V` `[n, 3]` has the garment's vertices in another order, or unit.

    Cloth hardly stretches: in the right order nearly every edge is about as long as in the template.
    """
    edges = unique_edges(garment.faces)
    length, rest = (np.linalg.norm(x[edges[:, 0]] - x[edges[:, 1]], axis=1) for x in (V, garment.template))
    good = (rest > 0) & np.isfinite(length)
    ratio = length[good] / rest[good]
    if not len(ratio):
        return
    middle = float(np.median(ratio))
    other = float(((ratio > _STRETCH * middle) | (ratio < middle / _STRETCH)).mean())
    if other > _SHARE:
        raise ValueError(
            f"{path}: in frame 0 {other:.0%} of the edges are over {_STRETCH:g} times longer or shorter than "
            f"in {garment_path}; export both with the same vertex order (keep it on import, too)."
        )
    if not 1 / _STRETCH < middle < _STRETCH:
        raise ValueError(
            f"{path}: in frame 0 the edges are {middle:.3g} times as long as in {garment_path}; give the "
            "unit of each (--clip-unit cm), or export both with the same vertex order."
        )
