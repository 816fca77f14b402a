"""MDD, Lightwave's motion designer file: big-endian; times in seconds, then positions frame by frame.

Header: int32 frames, int32 points, float32 time of every frame. It says neither triangles nor unit or axis.
"""

import struct
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from garment_jax.body.rates import rate_of_times
from garment_jax.io.formats.mesh_cache import Frames, MeshCache, check_length
from garment_jax.storage.missing import not_a_file

_HEADER = struct.Struct(">ii")


class MddHeader(NamedTuple):
    """What an MDD file says of itself."""

    times: np.ndarray  # [t] float64 seconds
    points: int
    first: int  # byte at which the positions begin
    notes: tuple[str, ...]  # on frames beyond those announced


def read_mdd(path: str | Path) -> MeshCache:
    """Open an MDD file: vertices `[t, n, 3]` are read by windows, the file's own unit and axes.

    `fps` follows from the times; None for a single frame, uneven times, and times that count frames. Frames
    beyond those announced are left out, which a note says. Raises `FileNotFoundError`, or `ValueError` where
    the file is not as long as its header says.
    """
    path = Path(path)
    head = read_mdd_header(path)
    stored = np.memmap(path, ">f4", "r", head.first, (len(head.times), head.points, 3))
    vertices = Frames(stored.shape, lambda start, stop: stored[start:stop].astype(np.float32))
    return MeshCache(vertices, None, None, None, rate_of_times(head.times), None, None, notes=head.notes)


def read_mdd_header(path: Path) -> MddHeader:
    """Return the header, checked against the file's size before anything is read or reserved."""
    if not path.is_file():
        raise not_a_file(path, "name an MDD file")
    size = path.stat().st_size
    with path.open("rb") as file:
        raw = file.read(_HEADER.size)
        frames, points = _HEADER.unpack(raw) if len(raw) == _HEADER.size else (0, 0)
        if frames < 1 or points < 1:
            raise ValueError(
                f"{path} announces {frames} frames of {points} points in its {size} bytes; it is no MDD file "
                "or damaged, export it again."
            )
        timed, rest = divmod(size - _HEADER.size, 4 + 12 * points)  # frames that each have a time
        timed = frames if rest else max(timed, frames)
        first = _HEADER.size + 4 * timed
        notes = check_length(size, first, frames, points, path, "an MDD file")
        return MddHeader(np.frombuffer(file.read(4 * frames), ">f4").astype(np.float64), points, first, notes)


def write_mdd(
    path: str | Path,
    windows: Iterable[np.ndarray],
    frames: int,
    points: int,
    *,
    fps: float,
    first_frame: float = 0.0,
) -> None:
    """Write `windows` of frames, each `[k, points, 3]` in the file's unit and axes, `frames` in all.

    Frame k has the time `(first_frame + k) / fps`. Raises `ValueError` when another number of frames comes.
    Writes straight to `path`: the caller gives a temporary name.
    """
    written = 0
    with Path(path).open("wb") as file:
        file.write(_HEADER.pack(frames, points))
        file.write(((first_frame + np.arange(frames)) / fps).astype(">f4").tobytes())
        for vertices in windows:
            file.write(np.ascontiguousarray(vertices, ">f4").tobytes())
            written += len(vertices)
    if written != frames:
        raise ValueError(f"{path}: {written} frames came, {frames} were announced.")
