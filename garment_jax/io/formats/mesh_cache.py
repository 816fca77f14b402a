"""Animated meshes of other programs: one structure for all formats.

Values are the file's own: its unit, its axes, its vertex order. Nothing is converted here.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np


class MeshCache(NamedTuple):
    """A mesh that moves while its triangles stay (the file's own unit and axes)."""

    vertices: Any  # [t, n, 3] float32, or what has such a shape and is sliced by frames (`Frames`)
    faces: np.ndarray | None  # [f, 3] int32, polygons as fans; None where the format has none
    uv: np.ndarray | None  # [u, 2] float32
    faces_uv: np.ndarray | None  # [f, 3] int32 indices into uv
    fps: float | None  # frames a second, None where the format does not say
    unit: float | None  # metres per unit of length, None where the format does not say
    up: str | None  # "Y" or "Z", None where the format does not say
    frames_a_sample: float = 1.0  # of a scene whose rate the file does not say; `vertices` are its samples
    notes: tuple[str, ...] = ()  # what of the file was left out, a phrase each


def check_length(size: int, head: int, frames: int, points: int, path: Path, kind: str) -> tuple[str, ...]:
    """Return a note where whole frames follow those that a point cache announces: left out, as rows of BVH.

    Raises `ValueError` for any other number of bytes `size`, of which `head` are no positions.
    """
    expected = head + 12 * frames * points
    extra, rest = divmod(size - expected, 12 * points)
    if extra < 0 or rest:
        raise ValueError(
            f"{path} has {size} bytes, but as {kind} it announces {frames} frames of {points} points, which "
            f"take {expected}; copy or export it again."
        )
    more = "1 frame" if extra == 1 else f"{extra} frames"
    verb = "is" if extra == 1 else "are"
    return (f"{more} more than the {frames} announced {verb} left out",) if extra else ()


class Frames:
    """Vertices `[t, n, 3]` float32 that are read when they are sliced by frames, and never all at once.

    `read(start, stop)` returns frames `start … stop - 1`, `[k, n, 3]`; `keep` is held as long as this is.
    """

    dtype = np.dtype(np.float32)
    ndim = 3

    def __init__(
        self, shape: tuple[int, int, int], read: Callable[[int, int], np.ndarray], *, keep: Any = None
    ) -> None:
        self.shape = shape
        self._read = read
        self._keep = keep

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, frames: int | slice) -> np.ndarray:
        """Return one frame `[n, 3]`, or the frames of a slice `[k, n, 3]`."""
        if isinstance(frames, slice):
            start, stop, step = frames.indices(len(self))
            if step != 1:
                chosen = range(start, stop, step)
                none = np.zeros((0, *self.shape[1:]), np.float32)
                return np.stack([self[k] for k in chosen]) if len(chosen) else none
            return self._read(start, max(start, stop))
        if not -len(self) <= frames < len(self):
            raise IndexError(f"frame {frames} of {len(self)}")
        return self._read(frames % len(self), frames % len(self) + 1)[0]


def choose_mesh(names: list[str], wanted: str | None, where: str, option: str = "--mesh") -> str:
    """Return the mesh to read: the one `wanted` (a path or its last part), the only one, or the garment.

    A name's parts are divided by "/". Raises `ValueError` with the names, and the `option` that takes one,
    where that leaves none or several.
    """
    listed = ", ".join(names[:8]) + (", …" if len(names) > 8 else "")
    if not names:
        raise ValueError(f"{where} holds no mesh; export the garment as a polygon mesh.")
    target = wanted or (names[0].rsplit("/")[-1] if len(names) == 1 else "garment")
    exact = [name for name in names if name == target]
    found = exact or [name for name in names if name.rsplit("/", 1)[-1].lower() == target.lower()]
    if len(found) == 1:
        return found[0]
    if wanted:
        raise ValueError(f"{where} has {len(found)} meshes named {wanted!r}; {option} takes one of {listed}.")
    raise ValueError(
        f"{where} holds several meshes; choose one with {option} NAME: {listed}, or call it Garment."
    )
