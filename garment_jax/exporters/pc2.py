"""PC2 with the matching OBJ: Blender's mesh cache modifier, 3ds Max, Marvelous Designer."""

from pathlib import Path

from garment_jax.exporters.clip import ExportClip
from garment_jax.exporters.point_cache import export_cache
from garment_jax.io.formats.pc2 import write_pc2


def export_pc2(clip: ExportClip, out: Path) -> list[Path]:
    """Write PC2 and OBJ of garment and body; return the files. PC2 keeps no frame rate."""
    return export_cache(
        clip,
        out,
        lambda path, windows, frames, points: write_pc2(
            path, windows, frames, points, first_frame=clip.first_frame
        ),
    )
