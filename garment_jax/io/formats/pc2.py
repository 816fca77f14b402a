"""PC2, point cache 2: little-endian; a header of 32 bytes, then float32 positions frame by frame.

Header: "POINTCACHE2" and a zero byte, int32 version 1, int32 points, float32 first frame, float32 frames a
sample, int32 samples. It says neither triangles nor a frame rate, unit or axis.
"""

import math
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from garment_jax.io.formats.mesh_cache import MeshCache, check_length
from garment_jax.storage.missing import not_a_file

MAGIC = b"POINTCACHE2\0"
_HEADER = struct.Struct("<12siiffi")


class Pc2Header(NamedTuple):
    """What a PC2 file says of itself."""

    points: int
    first_frame: float
    frames_a_sample: float
    samples: int
    notes: tuple[str, ...] = ()  # on frames beyond those announced


def read_pc2(path: str | Path) -> MeshCache:
    """Open a PC2 file: vertices `[t, n, 3]` are memory-mapped, the file's own unit and axes.

    Frames beyond those announced are left out, which a note says. Raises `FileNotFoundError`, or `ValueError`
    for what is no PC2 or is not as long as its header says.
    """
    path = Path(path)
    header = read_pc2_header(path)
    shape = (header.samples, header.points, 3)
    vertices = np.memmap(path, "<f4", "r", _HEADER.size, shape)
    return MeshCache(vertices, None, None, None, None, None, None, header.frames_a_sample, header.notes)


def read_pc2_header(path: Path) -> Pc2Header:
    """Return the header, checked against the file's size before anything is read or reserved."""
    if not path.is_file():
        raise not_a_file(path, "name a PC2 file")
    with path.open("rb") as file:
        raw = file.read(_HEADER.size)
    if len(raw) < _HEADER.size or not raw.startswith(MAGIC):
        raise ValueError(f"{path} is no PC2 file: it does not begin with POINTCACHE2; export it again.")
    _, version, points, first, step, samples = _HEADER.unpack(raw)
    if version != 1:
        raise ValueError(f"{path} is PC2 version {version}, only 1 is known; export it as version 1.")
    if points < 1 or samples < 1:
        raise ValueError(f"{path} announces {samples} frames of {points} points; export it again.")
    if not (math.isfinite(step) and step >= 0):
        raise ValueError(f"{path} announces {step} frames a sample; export it again.")
    notes = check_length(path.stat().st_size, _HEADER.size, samples, points, path, "a PC2 file")
    return Pc2Header(points, first, step or 1.0, samples, notes)  # 0: its writer left it out


def write_pc2(
    path: str | Path, windows: Iterable[np.ndarray], frames: int, points: int, *, first_frame: float = 0.0
) -> None:
    """Write `windows` of frames, each `[k, points, 3]` in the file's unit and axes, `frames` in all.

    Raises `ValueError` when another number of frames comes. Writes straight to `path`: the caller gives a
    temporary name.
    """
    written = 0
    with Path(path).open("wb") as file:
        file.write(_HEADER.pack(MAGIC, 1, points, first_frame, 1.0, frames))
        for vertices in windows:
            file.write(np.ascontiguousarray(vertices, "<f4").tobytes())
            written += len(vertices)
    if written != frames:
        raise ValueError(f"{path}: {written} frames came, {frames} were announced.")
