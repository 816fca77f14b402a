"""`garment-jax validate --fix`: repaired copies where the repair is safe; the input is never touched."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from garment_jax.body.bvh import read_bvh
from garment_jax.importers.finding import Finding, Repair
from garment_jax.io.formats.damage import reading
from garment_jax.io.formats.npz import npz_names, read_npz
from garment_jax.io.sequence_writer import DEFAULT_SCALE, SequenceWriter
from garment_jax.storage.scratch import sweep
from garment_jax.storage.whole import written_whole
from garment_jax.structs import RiggedBody
from garment_jax.validation.body_checks import body_unit, check_weights
from garment_jax.validation.clip_checks import check_clip
from garment_jax.validation.motion_checks import check_bvh
from garment_jax.validation.raw_clip import RawClip
from garment_jax.validation.validate import check_garment, lenient_body

_BLOCKING = ("vertex count", "frame count", "NaN", "rotations", "static")  # a copy would be as useless
_OWN = ("fps", "length_unit", "up_axis", "schema_version", "scene_hash")  # attributes that the writer sets
_WORDS = {
    "unit": "all lengths times {:g}",
    "root unit": "root positions times {:g}",
    "frames unit": "frames times {:g}",
    "up": "turned from Z up to Y up",
    "canonical up": "body and template turned from Z up to Y up",
    "world up": "motion turned from Z up to Y up",
    "attributes": "attributes put right",
    "weights": "weights normalised",
    "first": "the first {:g} frames dropped",
    "last": "the last {:g} frames dropped",
    "fps": "frame rate set to {:g}",
}


class Fixed(NamedTuple):
    """What became of one file."""

    source: Path
    path: Path | None  # of the copy; None where there was nothing to repair, or it was refused
    done: list[str]
    refused: str = ""

    def sentence(self) -> str:
        """Return it in words."""
        if self.refused:
            return f"not fixed: {self.source}: {self.refused}"
        if self.path is None:
            return f"nothing to fix: {self.source}"
        return f"fixed: {self.source} -> {self.path}: {'; '.join(self.done)}"


def target(path: Path, out: Path) -> Path:
    """Return where the copy of `path` goes: under its split's folder where it has one."""
    folder = path.resolve().parent.name
    return out / folder / path.name if folder in ("train", "test") else out / path.name


def check_out(files: Sequence[Path], out: Path) -> None:
    """Raise `ValueError` if a copy would replace one of `files`, or another copy; `OSError` for no folder."""
    if out.exists() and not out.is_dir():
        raise OSError(f"--out {out} is no folder; choose another one.")
    taken: dict[Path, Path] = {}
    for path in files:
        to = target(path, out).resolve()
        if to in {file.resolve() for file in files}:
            raise ValueError(f"--out {out} would replace {path}; choose another folder.")
        if to in taken:
            raise ValueError(f"{path} and {taken[to]} would both become {to}; fix them in two calls.")
        taken[to] = path


def fix_file(path: Path, files: Sequence[Path], out: Path, *, fps: float | None = None) -> Fixed:
    """Write the repaired copy of one file, whole or not at all; what is in the way is told, not raised.

    A file that is there stays: copies keep no word of who wrote them.
    """
    fixers: dict[str, Callable[[Path, Path, float | None], list[str]]] = {
        ".h5": _fix_clip,
        ".bvh": _fix_bvh,
        ".obj": _fix_garment,
        ".npz": _fix_body,
    }
    fixer = fixers.get(path.suffix.lower())
    if fixer is None or path.is_dir():
        return Fixed(path, None, [])
    if not path.exists():
        return Fixed(path, None, [], "it is not there")
    to = target(path, out)
    try:
        with reading(path):
            done = fixer(path, to, fps)
    except (ValueError, OSError) as error:
        return Fixed(path, None, [], str(error).removeprefix(f"{path}: "))
    return Fixed(path, to if done else None, done)


def _said(repairs: Sequence[Repair]) -> list[str]:
    said = [_WORDS[repair.kind].format(repair.amount) for repair in repairs]
    return [text.replace(" 1 frames ", " frame ") for text in said]


def _fix_clip(path: Path, to: Path, fps: float | None) -> list[str]:
    with RawClip(path) as clip:
        if fps is not None and fps != clip.fps:
            clip.repair(Repair("fps", fps))
        found = check_clip(clip)
        if not clip.repairs:
            return []
        _refuse_blocking(found, clip)
        _write_clip(clip, to)
        return _said(clip.repairs)


def _refuse_blocking(found: Sequence[Finding], clip: RawClip) -> None:
    for finding in found:
        if finding.check in _BLOCKING and finding.severity == "error":
            raise ValueError(f"{finding.value}; {finding.remedy}, then fix the rest.")
    if clip.fps is None:
        raise ValueError("it has no frame rate; give its true one with --fps.")
    uv = clip.scene.garment.uv
    if uv.min() < -1e-4 or uv.max() > 1 + 1e-4:
        raise ValueError("its UVs are outside 0 … 1; import the clip again with --fit-uv.")


def _check_free(to: Path) -> None:
    if to.exists():
        sweep(to.parent)
        raise ValueError(f"{to} is there already; move it away, or name another --out.")


def _write_clip(clip: RawClip, to: Path) -> None:
    _check_free(to)
    attributes = {key: value for key, value in clip.attributes.items() if key not in _OWN}
    encoding = "none" if not clip.moves_cloth else "float32" if clip.stored_scale is None else "int16"
    try:
        _write_as(clip, to, encoding, attributes)
    except ValueError:
        if encoding != "int16":
            raise
        _write_as(clip, to, "float32", attributes)  # out of int16's reach


def _write_as(clip: RawClip, to: Path, encoding: str, attributes: dict) -> None:
    scale = clip.stored_scale or DEFAULT_SCALE
    with SequenceWriter(
        to, clip.scene, clip.motion, encoding=encoding, scale=min(scale, DEFAULT_SCALE), attributes=attributes
    ) as writer:
        for start in range(0, clip.frames if clip.moves_cloth else 0, 64):
            writer.append(clip.read(start, min(start + 64, clip.frames)))
        for name, values in clip.read_extra().items():
            writer.add_per_frame(name, values)


def _fix_bvh(path: Path, to: Path, fps: float | None) -> list[str]:
    repairs = [f.repair for f in check_bvh(path, fps=fps) if f.repair is not None]
    frames = len(read_bvh(path).root)
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    head, _, body = text.partition("MOTION")
    lines = [line for line in body.splitlines() if line.strip()]
    head_rows = next(k for k, line in enumerate(lines, 1) if "time:" in line.lower().replace(" ", ""))
    rows = lines[head_rows : head_rows + frames]
    first = sum(int(r.amount) for r in repairs if r.kind == "first")
    last = sum(int(r.amount) for r in repairs if r.kind == "last")
    rows = rows[first : len(rows) - last]
    timing = re.search(r"Frame\s+Time:\s*(\S+)", body, re.IGNORECASE)
    shown = timing[1] if fps is None and timing else f"{1 / (fps or 30.0):.8f}"
    if fps is not None:
        repairs.append(Repair("fps", fps))
    if repairs:
        _write_text(
            to, "\n".join([f"{head}MOTION", f"Frames: {len(rows)}", f"Frame Time: {shown}", *rows, ""])
        )
    return _said(repairs)


def _fix_garment(path: Path, to: Path, fps: float | None) -> list[str]:
    repair = next((f.repair for f in check_garment(path) if f.repair is not None), None)
    if repair is None:
        return []
    lines = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            scaled = [f"{float(word) * repair.amount:.9g}" for word in words[1:4]]
            line = " ".join(["v", *scaled, *words[4:]])
        lines.append(line)
    _write_text(to, "\n".join([*lines, ""]))
    return _said([repair])


def _fix_body(path: Path, to: Path, fps: float | None) -> list[str]:
    if "skin_weights" not in npz_names(path):
        return []
    arrays = read_npz(path)
    body = lenient_body({name: arrays[name] for name in RiggedBody._fields}, path)
    repairs = [
        f.repair for f in (body_unit(body), *check_weights(body.skin_weights, "skin weights")) if f.repair
    ]
    for repair in repairs:
        if repair.kind == "unit":
            arrays |= {name: arrays[name] * np.float32(repair.amount) for name in ("vertices", "joints")}
        else:
            weights = arrays["skin_weights"]
            arrays["skin_weights"] = weights / weights.sum(axis=1, keepdims=True)
    if repairs:
        _write_arrays(to, arrays)
    return _said(repairs)


def _write_text(path: Path, text: str) -> None:
    _write(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def _write_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    def save(temporary: Path) -> None:
        with temporary.open("wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]

    _write(path, save)


def _write(path: Path, write: Callable[[Path], object]) -> None:
    _check_free(path)
    with written_whole(path, remedy="choose another folder") as (made,):
        write(made)
