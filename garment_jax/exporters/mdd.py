"""MDD with the matching OBJ: Blender's mesh cache modifier, Houdini, Lightwave, Modo."""

from pathlib import Path

from garment_jax.exporters.clip import ExportClip
from garment_jax.exporters.point_cache import export_cache
from garment_jax.io.formats.mdd import write_mdd


def export_mdd(clip: ExportClip, out: Path) -> list[Path]:
    """Write MDD and OBJ of garment and body; return the files. Times are seconds from frame 0."""
    return export_cache(
        clip,
        out,
        lambda path, windows, frames, points: write_mdd(
            path, windows, frames, points, fps=clip.fps, first_frame=clip.first_frame
        ),
    )
