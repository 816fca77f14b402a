"""The sequence file: one clip of a garment on a moving body, simulated or predicted (HDF5).

Truth and prediction share one layout (`layout.py`, `docs/formats.md`). Vertices are stored in chunks of
frames and read by windows, so that no clip need fit into memory.
"""

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np

from garment_jax.body.frame_windows import FrameWindows
from garment_jax.io import layout
from garment_jax.io.attributes import check_attributes
from garment_jax.io.formats.damage import reads_foreign
from garment_jax.io.hdf5 import (
    attributes_of,
    dataset,
    dataset_names,
    names_in,
    open_hdf5,
    read_all,
    read_window,
)
from garment_jax.io.sequence_writer import DEFAULT_SCALE, MOTION_ONLY, SequenceWriter
from garment_jax.structs import Motion, Scene

__all__ = ["DEFAULT_SCALE", "Sequence", "SequenceWriter", "chosen_frames", "open_sequence"]


class Sequence:
    """An open sequence file; use it in a `with` statement (see `open_sequence`).

    `scene` is read whole (small), vertices by windows. `motion` is read whole when it is first asked for;
    `long_motion` is the same with rotations that are read in stretches, from the open file
    (`FrameWindows`). All values are metres, world frame, Y up. A file of kind "motion" holds no vertices: a
    motion to be animated.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._file = open_hdf5(self.path)
        try:
            self.attributes = check_attributes(self._file, str(self.path))
            arrays = read_arrays(self._file, str(self.path), in_stretches=("rotations",))
            sizes = layout.check_arrays(arrays, str(self.path))  # reads the rotations once, in stretches
            self._vertices, self._scale = _find_vertices(self._file, sizes, str(self.path))
        except BaseException:
            self._file.close()
            raise
        self.scene: Scene = layout.to_scene(arrays)
        self.fps = float(self.attributes["fps"])
        self.long_motion = Motion(arrays["rotations"], arrays["root"], self.fps)
        self.frames = sizes["t"]
        self.name = str(self.attributes.get("name", self.path.stem))

    @cached_property
    def motion(self) -> Motion:
        """The whole motion in memory; it stays usable when the file is closed."""
        return self.long_motion._replace(rotations=np.asarray(self.long_motion.rotations))

    def read(self, start: int, stop: int) -> np.ndarray:
        """Return the garment's vertices of frames `start … stop - 1`, `[k, n, 3]` float32 world metres.

        Reads only that window. Raises ValueError for frames that the clip does not have and OSError
        where the file is damaged.
        """
        self._check_window(start, stop)
        if self._vertices is None:
            raise ValueError(
                f"{self.path} holds a motion without garment vertices; animate it with infer.py or name a "
                "simulated clip."
            )
        stored = read_window(self._vertices, start, stop, self.path)
        if self._scale is None:
            return stored.astype(np.float32, copy=False)
        root = self.motion.root[start:stop, None]
        return (stored * self._scale + root).astype(np.float32)

    def windows(self, size: int = 64) -> Iterator[tuple[int, np.ndarray]]:
        """Yield `(start, vertices [k, n, 3])` over the whole clip, `size` frames at a time."""
        for start in range(0, self.frames, size):
            yield start, self.read(start, min(start + size, self.frames))

    @property
    def encoding(self) -> str:
        """How vertices are stored: "int16" (relative to the root), "float32" (world) or "none"."""
        if self._vertices is None:
            return "none"
        return "float32" if self._scale is None else "int16"

    @property
    def scale(self) -> float | None:
        """Metres per step of int16 vertices, None for other encodings."""
        return self._scale

    @property
    def extra_names(self) -> tuple[str, ...]:
        """Names of the further per-frame datasets (group `extra`)."""
        return names_in(self._file, "extra", str(self.path))

    def read_extra(self, name: str, start: int, stop: int) -> np.ndarray:
        """Return frames `start … stop - 1` of the per-frame dataset `extra/name`, `[k, ...]`."""
        self._check_window(start, stop)
        if name not in self.extra_names:
            raise ValueError(f"{self.path}: no per-frame data named {name!r}; it has {self.extra_names}.")
        return read_window(dataset(self._file, f"extra/{name}", str(self.path)), start, stop, self.path)

    def close(self) -> None:
        """Close the file; `scene`, and `motion` where it has been asked for, stay usable."""
        self._file.close()

    def __enter__(self) -> "Sequence":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _check_window(self, start: int, stop: int) -> None:
        if not 0 <= start < stop <= self.frames:
            raise ValueError(
                f"{self.path}: frames {start} … {stop} asked of {self.frames}; "
                f"choose 0 <= start < stop <= {self.frames}."
            )


@reads_foreign
def open_sequence(path: str | Path) -> Sequence:
    """Open a sequence file for reading.

    Raises FileNotFoundError, OSError (truncated, not HDF5) or ValueError (what does not fit, by name),
    each in one sentence with the remedy.
    """
    return Sequence(path)


def chosen_frames(clip: Sequence, start: int = 0, stop: int | None = None) -> range:
    """Return the numbers of frames `start … stop - 1` (None: to the end); `ValueError` for others."""
    stop = clip.frames if stop is None else stop
    if not 0 <= start < stop <= clip.frames:
        raise ValueError(
            f"{clip.path} has {clip.frames} frames; --start {start} --stop {stop} must fit "
            f"0 <= start < stop <= {clip.frames}."
        )
    return range(start, stop)


def read_arrays(file: h5py.File, where: str, *, in_stretches: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the datasets of the layout that the file has, without the vertices, in their types.

    Those named `in_stretches` are `FrameWindows` of the open file. Raises as `open_sequence`, for what is
    damaged or does not fit its own type and number of axes.
    """
    present = dataset_names(file, where)
    arrays = {}
    for field in layout.fields_of(present):
        if field.name in present:
            stored = dataset(file, field.name, where)
            if field.name in in_stretches and stored.shape is not None:
                arrays[field.name] = _in_stretches(field, stored, where)
                continue
            found = read_all(stored, where, text=field.dtype == "U")
            arrays[field.name] = layout.cast(field, found, where)
    return arrays


def _in_stretches(field: layout.Field, stored: h5py.Dataset, where: str) -> FrameWindows:
    layout.check_kind(field, stored.shape, stored.dtype, where)

    def read(start: int, stop: int) -> np.ndarray:
        return layout.cast(field, read_window(stored, start, stop, Path(where)), where)

    return FrameWindows(read, stored.shape, field.dtype)


def _find_vertices(
    file: h5py.File, sizes: dict[str, int], where: str
) -> tuple[h5py.Dataset | None, float | None]:
    if attributes_of(file, where).get("kind") == MOTION_ONLY:
        return None, None
    vertices = dataset(file, "vertices", where)
    expected = (sizes["t"], sizes["n"], 3)
    if vertices.shape != expected:
        raise ValueError(
            f"{where}: `vertices` has shape {vertices.shape}, but `root` and `template` ask for {expected}; "
            "write all three from the same clip and garment."
        )
    if vertices.dtype == np.float32:
        return vertices, None
    if vertices.dtype != np.int16:
        raise ValueError(f"{where}: `vertices` has type {vertices.dtype}; store float32 metres or int16.")
    scale = attributes_of(vertices, where).get("scale")
    if not isinstance(scale, float) or not 0 < scale < 1:
        raise ValueError(f"{where}: attribute scale of int16 `vertices` is {scale!r}; give metres per step.")
    return vertices, scale
