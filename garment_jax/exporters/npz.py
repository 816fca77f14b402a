"""NumPy's archive: plain arrays for Python, MATLAB and scripts of one's own."""

import zipfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from garment_jax.exporters.clip import ExportClip
from garment_jax.storage.whole import written_whole


def export_npz(clip: ExportClip, out: Path) -> list[Path]:
    """Write an `.npz` of arrays, not compressed; return the file.

    `vertices` [t, n, 3], `faces` [f, 3], `uv` [u, 2], `faces_uv` [f, 3], `template` [n, 3], `fps`, `unit`
    (metres), `up`, `first_frame`, and with the body `body_vertices` [t, b, 3] and `body_faces` [g, 3].
    """
    garment = clip.garment
    facts = {"fps": clip.fps, "unit": clip.unit, "up": clip.up, "first_frame": clip.first_frame}
    arrays = {name: np.asarray(value) for name, value in facts.items()}
    arrays |= {"faces": garment.faces, "uv": garment.uv, "faces_uv": garment.faces_uv}
    arrays["template"] = clip.place(garment.template)
    arrays |= {"body_faces": clip.body.faces} if clip.with_body else {}
    with written_whole(out) as (path,), zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w") as member:
                np.lib.format.write_array(member, array, allow_pickle=False)
        _write_frames(archive, "vertices", clip.garment_windows(), (clip.frames, len(garment.template), 3))
        if clip.with_body:
            shape = (clip.frames, len(clip.body.vertices), 3)
            _write_frames(archive, "body_vertices", clip.body_windows(), shape)
    return [out]


def _write_frames(
    archive: zipfile.ZipFile, name: str, windows: Iterable[np.ndarray], shape: tuple[int, int, int]
) -> None:
    """Write an array window by window: np.savez would want all of it in memory."""
    header = {"descr": "<f4", "fortran_order": False, "shape": shape}
    with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
        np.lib.format.write_array_header_1_0(member, header)
        for vertices in windows:
            member.write(np.ascontiguousarray(vertices, "<f4").tobytes())
