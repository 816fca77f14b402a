"""MDD, Lightwave's motion designer file: big-endian; times in seconds, then positions frame by frame.

Header: int32 frames, int32 points, float32 time of every frame. It says neither triangles nor unit or axis.
"""

import struct
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from garment_jax.body.rates import rate_of_times
from garment_jax.formats.mesh_cache import Frames, MeshCache

_HEADER = struct.Struct(">ii")


def read_mdd(path: str | Path) -> MeshCache:
    """Open an MDD file: vertices `[t, n, 3]` are read by windows, the file's own unit and axes.

    `fps` follows from the times; None for a single frame, uneven times, and times that count frames. Raises
    `FileNotFoundError`, or `ValueError` where the file is not as long as its header says.
    """
    path = Path(path)
    times, points = read_times(path)
    stored = np.memmap(path, ">f4", "r", _HEADER.size + 4 * len(times), (len(times), points, 3))
    vertices = Frames(stored.shape, lambda start, stop: stored[start:stop].astype(np.float32))
    return MeshCache(vertices, None, None, None, rate_of_times(times), None, None)


def read_times(path: Path) -> tuple[np.ndarray, int]:
    """Return the frames' times `[t]` in seconds (float64) and the number of points."""
    if not path.is_file():
        raise FileNotFoundError(f"{path} is not there; name an MDD file.")
    size = path.stat().st_size
    with path.open("rb") as file:
        raw = file.read(_HEADER.size)
        frames, points = _HEADER.unpack(raw) if len(raw) == _HEADER.size else (0, 0)
        if frames < 1 or points < 1:
            raise ValueError(
                f"{path} announces {frames} frames of {points} points in its {size} bytes; it is no MDD file "
                "or damaged, export it again."
            )
        expected = _HEADER.size + 4 * frames + 12 * frames * points
        if size != expected:
            raise ValueError(
                f"{path} has {size} bytes, but as an MDD file it announces {frames} frames of {points} "
                f"points, which take {expected}; copy or export it again."
            )
        return np.frombuffer(file.read(4 * frames), ">f4").astype(np.float64), points


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
