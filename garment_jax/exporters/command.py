"""`garment-jax export`: a sequence file becomes a file, or a folder, of another program's format."""

import time
from pathlib import Path
from typing import NamedTuple

from garment_jax.exporters.abc import export_abc
from garment_jax.exporters.cache_files import cache_files
from garment_jax.exporters.clip import ExportClip, Progress
from garment_jax.exporters.mdd import export_mdd
from garment_jax.exporters.npz import export_npz
from garment_jax.exporters.obj import export_obj
from garment_jax.exporters.pc2 import export_pc2
from garment_jax.io.sequence import open_sequence
from garment_jax.storage.overwriting import check_free

SUFFIXES = {
    "usd": (".usd", ".usda", ".usdc", ".usdz"),
    "glb": (".glb",),
    "pc2": (".pc2",),
    "mdd": (".mdd",),
    "npz": (".npz",),
    "abc": (".abc",),
    "onnx": (".onnx",),
    "obj": ("",),
}


class Report(NamedTuple):
    """What was written."""

    files: list[Path]  # files, or the folder
    frames: int
    bytes: int
    seconds: float
    note: str = ""  # what is lost on the way


def export_file(
    path: str | Path,
    out: str | Path,
    *,
    format: str | None = None,
    unit: str = "m",
    up: str = "Y",
    fps: float | None = None,
    frame_offset: int = 0,
    start: int = 0,
    stop: int | None = None,
    every: int = 1,
    body: bool = True,
    blender: str | Path | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> Report:
    """Export the sequence file `path` to `out` and report.

    `format` is one of `SUFFIXES` (default: by `out`'s suffix). `unit` m, cm or mm; `up` Y or Z; `fps` is
    written instead of the clip's own, frames are not resampled; `frame_offset` numbers the first frame;
    `every` is for glb alone; `force` replaces what is there. Output appears when it is whole. Raises
    `ValueError`, `FileNotFoundError` or `OSError` in one sentence.
    """
    path, out, began = Path(path), Path(out), time.perf_counter()
    if out.resolve() == path.resolve():
        raise ValueError(f"--out {out} is what is read; write to another file.")
    chosen = choose_format(out, format)
    if chosen == "onnx":
        raise ValueError(f"{path}: --format onnx exports a model; name a run or a model folder.")
    if every != 1 and chosen != "glb":
        raise ValueError(
            f"--every {every} is for --format glb, whose frames are morph targets; leave it out."
        )
    if chosen == "obj" and out.is_file():
        raise ValueError(f"--out {out} is a file; OBJ files, one a frame, fill a folder, name a new one.")
    for file in cache_files(out, body=body) if chosen in ("pc2", "mdd") else [out]:
        check_free(file, force, frames=chosen == "obj")
    with open_sequence(path) as sequence:
        options = {"unit": unit, "up": up, "fps": fps, "start": start, "stop": stop, "body": body}
        clip = ExportClip(sequence, first_frame=frame_offset, progress=progress, **options)
        if chosen == "glb":
            return _export_glb(clip, out, every, began)
        files = _export(clip, out, chosen, blender)
        size = sum(part.stat().st_size for file in files for part in _parts(file))
        return Report(files, clip.frames, size, time.perf_counter() - began)


def choose_format(out: Path, format: str | None) -> str:
    """Return the format of `out`, checked against its suffix; raises `ValueError` where they disagree."""
    suffix = out.suffix.lower()
    if suffix == ".fbx":
        raise ValueError(f"--out {out}: FBX is not written; end it in .glb, .usdc or .abc.")
    if format is None:
        found = [name for name, suffixes in SUFFIXES.items() if suffix and suffix in suffixes]
        if not found and suffix:
            endings = ", ".join(known[0] for known in SUFFIXES.values() if known[0])
            raise ValueError(f"--out {out}: its ending names no format; end it in {endings}.")
        if not found:
            raise ValueError(f"--out {out}: its ending names no format; give --format {'|'.join(SUFFIXES)}.")
        return found[0]
    if format not in SUFFIXES:
        raise ValueError(f"--format {format} is unknown; choose {', '.join(SUFFIXES)}.")
    if format == "obj":
        if suffix == ".obj":
            raise ValueError(f"--out {out}: OBJ files, one a frame, fill a folder; name it without .obj.")
    elif suffix not in SUFFIXES[format]:
        raise ValueError(f"--out {out}: --format {format} is written to {' or '.join(SUFFIXES[format])}.")
    return format


def _export(clip: ExportClip, out: Path, chosen: str, blender: str | Path | None) -> list[Path]:
    if chosen == "abc":
        return export_abc(clip, out, blender=blender)
    if chosen == "usd":
        from garment_jax.exporters.usd import export_usd  # half a second of scipy

        return export_usd(clip, out)
    exporters = {
        "pc2": export_pc2,
        "mdd": export_mdd,
        "obj": export_obj,
        "npz": export_npz,
    }
    return exporters[chosen](clip, out)


def _export_glb(clip: ExportClip, out: Path, every: int, began: float) -> Report:
    from garment_jax.exporters.glb import write_glb  # loads JAX: a second that the others do without

    if clip.first_frame:
        raise ValueError(f"--frame-offset {clip.first_frame}: a GLB's time begins at 0; leave it out.")
    made = write_glb(
        clip.sequence,
        out,
        scale=clip.scale,
        up=clip.up,
        fps=clip.fps,
        start=clip.start,
        stop=clip.stop,
        every=every,
        body=clip.with_body,
    )
    error = made.body_error
    note = "" if error is None else f"body within {1e3 * error:.2f} mm (four joints a vertex)"
    return Report([out], made.frames, made.size, time.perf_counter() - began, note)


def _parts(path: Path) -> list[Path]:
    """Return the files that `path` is or holds."""
    return [part for part in path.rglob("*") if part.is_file()] if path.is_dir() else [path]
