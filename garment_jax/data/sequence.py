"""The sequence file: one clip of a garment on a moving body, simulated or predicted (HDF5).

Truth and prediction share one layout (`layout.py`, `docs/formats.md`). Vertices are stored in chunks of
frames and read by windows, so that no clip need fit into memory.
"""

from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

import h5py
import numpy as np

from garment_jax.data import layout
from garment_jax.data.sequence_writer import DEFAULT_SCALE, SequenceWriter
from garment_jax.structs import Motion, Scene

__all__ = ["DEFAULT_SCALE", "Sequence", "SequenceWriter", "open_sequence"]


class Sequence:
    """An open sequence file; use it in a `with` statement (see `open_sequence`).

    `scene` and `motion` are read whole (small), vertices by windows. All values are metres, world
    frame, Y up.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._file = _open_hdf5(self.path)
        try:
            self.attributes = _read_attributes(self._file, str(self.path))
            arrays = _read_arrays(self._file, str(self.path))
            sizes = layout.check_arrays(arrays, str(self.path))
            self._vertices, self._scale = _find_vertices(self._file, sizes, str(self.path))
        except BaseException:
            self._file.close()
            raise
        self.scene: Scene = layout.to_scene(arrays)
        self.fps = float(self.attributes["fps"])
        self.motion = Motion(arrays["rotations"], arrays["root"], self.fps)
        self.frames = sizes["t"]
        self.name = str(self.attributes.get("name", self.path.stem))

    def read(self, start: int, stop: int) -> np.ndarray:
        """Return the garment's vertices of frames `start … stop - 1`, `[k, n, 3]` float32 world metres.

        Reads only that window. Raises ValueError for frames that the clip does not have and OSError
        where the file is damaged.
        """
        self._check_window(start, stop)
        stored = _read_window(self._vertices, start, stop, self.path)
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
        """How vertices are stored: "int16" (relative to the root) or "float32" (world)."""
        return "float32" if self._scale is None else "int16"

    @property
    def extra_names(self) -> tuple[str, ...]:
        """Names of the further per-frame datasets (group `extra`)."""
        return tuple(self._file["extra"]) if "extra" in self._file else ()

    def read_extra(self, name: str, start: int, stop: int) -> np.ndarray:
        """Return frames `start … stop - 1` of the per-frame dataset `extra/name`, `[k, ...]`."""
        self._check_window(start, stop)
        if name not in self.extra_names:
            raise ValueError(f"{self.path}: no per-frame data named {name!r}; it has {self.extra_names}.")
        return _read_window(self._file["extra"][name], start, stop, self.path)

    def close(self) -> None:
        """Close the file; `scene` and `motion` stay usable."""
        self._file.close()

    def __enter__(self) -> Self:
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


def open_sequence(path: str | Path) -> Sequence:
    """Open a sequence file for reading.

    Raises FileNotFoundError, OSError (truncated, not HDF5) or ValueError (what does not fit, by name),
    each in one sentence with the remedy.
    """
    return Sequence(path)


def _open_hdf5(path: Path) -> h5py.File:
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file; give the path of a sequence file (.h5).")
    try:
        return h5py.File(path, "r")
    except OSError as error:
        reason = "is truncated" if "truncated" in str(error) else "is damaged or no HDF5 file"
        raise OSError(f"{path} {reason}; copy, import or predict it again.") from error


def _read_attributes(file: h5py.File, where: str) -> dict:
    attributes = {key: _plain(value) for key, value in file.attrs.items()}
    if "vertices_delta" in file:
        raise ValueError(
            f"{where} is packed for transport; run `garment-jax import {where} --out DIR` first."
        )
    version = attributes.get("schema_version")
    if version != layout.SCHEMA_VERSION:
        raise ValueError(
            f"{where}: schema_version is {version}, this release reads {layout.SCHEMA_VERSION}; import it "
            "again with this release."
        )
    if "fps" not in attributes:
        raise ValueError(f"{where}: attribute fps is missing; set it to the clip's true frame rate.")
    fps = attributes["fps"]
    if not isinstance(fps, int | float) or not 0 < fps < 10_000:
        raise ValueError(f"{where}: fps is {fps!r}; set it to the clip's true frame rate, a number above 0.")
    for key, expected, remedy in (
        ("length_unit", "m", "convert all lengths to metres"),
        ("up_axis", "Y", "turn the clip so that Y is up"),
    ):
        if attributes.get(key) != expected:
            raise ValueError(
                f"{where}: {key} is {attributes.get(key)!r}, only {expected!r} is read; {remedy} and set "
                f"{key} = {expected!r}."
            )
    return attributes


def _plain(value: object) -> object:
    if isinstance(value, bytes):
        return value.decode()
    return value.item() if isinstance(value, np.generic) else value


def _read_arrays(file: h5py.File, where: str) -> dict[str, np.ndarray]:
    present: list[str] = []
    file.visititems(lambda name, item: present.append(name) if isinstance(item, h5py.Dataset) else None)
    arrays = {}
    try:
        for field in layout.fields_of(present):
            if field.name in present:
                arrays[field.name] = _read_array(file[field.name], field)
    except OSError as error:
        raise OSError(f"{where} is damaged or truncated; copy, import or predict it again.") from error
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"{where}: `{field.name}` has type {file[field.name].dtype}, not numbers."
        ) from error
    return arrays


def _read_array(dataset: h5py.Dataset, field: layout.Field) -> np.ndarray:
    if field.dtype == "U":
        return np.asarray(dataset.asstr()[()], dtype="U")
    return np.asarray(dataset[()]).astype(field.dtype, copy=False)


def _find_vertices(file: h5py.File, sizes: dict[str, int], where: str) -> tuple[h5py.Dataset, float | None]:
    if "vertices" not in file:
        raise ValueError(f"{where}: dataset `vertices` is missing; a sequence file needs it, [t, n, 3].")
    vertices = file["vertices"]
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
    scale = _plain(vertices.attrs.get("scale"))
    if not isinstance(scale, float) or not 0 < scale < 1:
        raise ValueError(f"{where}: attribute scale of int16 `vertices` is {scale!r}; give metres per step.")
    return vertices, scale


def _read_window(dataset: h5py.Dataset, start: int, stop: int, path: Path) -> np.ndarray:
    try:
        return dataset[start:stop]
    except OSError as error:
        raise OSError(
            f"{path}: frames {start} … {stop - 1} cannot be read, the file is damaged; copy, import or "
            "predict it again."
        ) from error
