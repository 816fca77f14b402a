"""Motions alone: files of kind "motion", to be animated by a trained model."""

from collections.abc import Sequence
from pathlib import Path

from garment_jax.importers.own_files import Wardrobe
from garment_jax.importers.sources import ForeignClip, Options, Source


def motion_sources(paths: Sequence[Path], options: Options) -> list[Source]:
    """Return the motions at `paths` on the body and in the garment that the options name.

    `ValueError` where either is not named.
    """
    wardrobe = Wardrobe(options, motions=paths)

    def read(path: Path) -> ForeignClip:
        motion, notes = wardrobe.motion(path, fps=options.fps, centre=True)
        return ForeignClip(wardrobe.dressed().scene, motion, None, (*notes, *wardrobe.dressed().notes))

    def source(path: Path) -> Source:
        return Source(path.stem, path, (path, *wardrobe.files()), lambda: read(path))

    return [source(path) for path in paths]
