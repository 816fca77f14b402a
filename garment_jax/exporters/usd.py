"""An animated USD stage: /Clip/Garment and /Clip/Body, points, normals and extent a frame."""

from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np

from garment_jax.evaluation.colours import body_colours, garment_colours, linear
from garment_jax.exporters.clip import ExportClip
from garment_jax.geometry.normals import vertex_normals
from garment_jax.io.formats.usd_library import load_pxr
from garment_jax.io.formats.usd_writer import UsdMesh, write_usd
from garment_jax.storage.whole import written_whole


def export_usd(clip: ExportClip, out: Path) -> list[Path]:
    """Write `.usd`, `.usda`, `.usdc` or `.usdz`; return the file. Needs the extra `usd`."""
    load_pxr()
    garment = clip.garment
    (cloth,) = garment_colours([str(clip.sequence.attributes.get("kind", ""))])
    meshes = [UsdMesh("Garment", garment.faces, garment.uv, garment.faces_uv, linear(cloth)[None])]
    if clip.with_body:
        meshes.append(UsdMesh("Body", clip.body.faces, None, None, linear(body_colours(clip.body))))
    with written_whole(out) as (path,):
        write_usd(
            path,
            meshes,
            _frames(clip),
            fps=clip.fps,
            first_frame=clip.first_frame,
            count=clip.frames,
            unit=clip.unit,
            up=clip.up,
        )
    return [out]


def _frames(clip: ExportClip) -> Iterator[list[tuple[np.ndarray, np.ndarray]]]:
    """Yield of every mesh its points and normals, frame by frame."""
    sources = [(clip.garment_windows(), clip.garment.faces)]
    sources += [(clip.body_windows(), clip.body.faces)] if clip.with_body else []
    normals = jax.jit(vertex_normals)
    for windows in zip(*(windows for windows, _ in sources), strict=True):
        for posed in zip(*windows, strict=True):
            yield [
                (V, _whole(np.asarray(normals(V, faces))))
                for V, (_, faces) in zip(posed, sources, strict=True)
            ]


def _whole(normals: np.ndarray) -> np.ndarray:
    """Return normals of length 1 everywhere: a vertex without area has none, and renderers want one."""
    return np.where(normals.any(axis=1, keepdims=True), normals, np.array([[0.0, 1.0, 0.0]], np.float32))
