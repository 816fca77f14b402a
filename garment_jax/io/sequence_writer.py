"""Writing a sequence file: frames are appended as they are made, the file appears when it is whole."""

from collections.abc import Callable
from pathlib import Path
from types import TracebackType

import h5py
import numpy as np
from numpy.typing import ArrayLike

from garment_jax.body.frame_windows import AT_ONCE, FrameWindows
from garment_jax.io import layout
from garment_jax.io.content_hash import scene_hash
from garment_jax.io.deferred_errors import GuardedFile, uninterrupted
from garment_jax.io.overwrite_checks import check_name
from garment_jax.storage.whole import Unfinished
from garment_jax.structs import Motion, Scene

DEFAULT_SCALE = 5e-5  # metres per int16 step: 0.025 mm of error at most, 1.638 m of reach
INT16_REACH = 0.99 * 32_767 * DEFAULT_SCALE  # metres from the root, with room for rounding
MOTION_ONLY = "motion"  # attribute `kind` of a file without vertices
_CHUNK_BYTES = 262_144  # a few hundred kB: one window is a few chunks, one frame never costs a clip


class SequenceWriter:
    """Writes a clip frame by frame; use it in a `with` statement.

    `with SequenceWriter(path, scene, motion) as w: w.append(V)` with `V` `[k, n, 3]` in world metres, in
    order, until exactly the motion's frames are written. The file is built in a scratch folder and moved
    into place at the end; on any error nothing is left and an older file stays as it was.

    `encoding="int16"` stores positions relative to the motion's root in steps of `scale` metres and
    refuses what is out of reach; "float32" stores world metres; "none" stores a motion alone, to be
    animated (attribute kind = "motion", nothing to append). `attributes` are free (name, source,
    split, kind = "simulated" or "predicted", …). `check` is called with the whole file before it takes its
    place; what it raises keeps it from there.
    """

    def __init__(
        self,
        path: str | Path,
        scene: Scene,
        motion: Motion,
        *,
        encoding: str = "int16",
        scale: float = DEFAULT_SCALE,
        attributes: dict | None = None,
        check: Callable[[Path], None] | None = None,
    ) -> None:
        self.path = Path(path)
        check_name(self.path)
        if encoding not in ("int16", "float32", "none"):
            raise ValueError(f"encoding={encoding!r} is unknown; choose 'int16', 'float32' or 'none'.")
        if not 0 < scale < 1:
            raise ValueError(f"scale={scale} metres per step is out of range; {DEFAULT_SCALE} is usual.")
        if not 0 < motion.fps < 10_000:
            raise ValueError(f"{self.path}: fps is {motion.fps!r}; give the motion its true frame rate.")
        self._arrays = layout.to_arrays(scene, motion, str(self.path))
        self._sizes = layout.check_arrays(self._arrays, str(self.path))
        self._scale = scale if encoding == "int16" else None
        self._attributes = {"kind": "simulated", "name": self.path.stem} | (attributes or {})
        self._attributes |= {
            "schema_version": layout.SCHEMA_VERSION,
            "fps": float(motion.fps),
            "length_unit": "m",
            "up_axis": "Y",
            "scene_hash": scene_hash(scene),
        }
        self._motion_only = encoding == "none"
        if self._motion_only:
            self._attributes["kind"] = MOTION_ONLY
        self._check = check
        self._written = 0
        self._unfinished: Unfinished | None = None
        self._disk: GuardedFile | None = None
        self._file: h5py.File | None = None

    def append(self, vertices: ArrayLike) -> None:
        """Write the next frames, `[k, n, 3]` (or one, `[n, 3]`) world metres.

        Raises ValueError for a wrong shape, too many frames, values that are not finite or out of
        int16's reach; OSError when the disk is full.
        """
        if self._motion_only:
            raise ValueError(f"{self.path} is written as a motion alone; give another encoding for vertices.")
        given = np.asarray(vertices)
        given = given[None] if given.ndim == 2 else given
        start, stop = self._written, self._written + len(given)
        self._check_frames(given, start, stop)
        stored = given if self._scale is None else self._quantise(given, start, stop, self._scale)
        with uninterrupted():
            self._vertices[start:stop] = stored
            self._copy(start, stop)
        self._check_disk()
        self._written = stop

    def add_per_frame(self, name: str, values: ArrayLike) -> None:
        """Write further values of every frame, `[t, ...]`, as dataset `extra/name`."""
        array = np.asarray(values)
        if len(array) != self._sizes["t"]:
            raise ValueError(f"{self.path}: {name!r} has {len(array)} frames, the clip {self._sizes['t']}.")
        with uninterrupted():
            self._open_file.create_dataset(f"extra/{name}", data=array, **_packing(array))
        self._check_disk()

    def __enter__(self) -> "SequenceWriter":
        if self.path.is_dir():
            raise ValueError(f"{self.path} is a folder; name a sequence file (.h5).")
        try:
            with uninterrupted():
                self._begin()
            self._check_disk()
        except BaseException:
            self._discard()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None:
            self._discard()
            return
        try:
            self._check_complete()
            self._close()
            self._check_disk()
            assert self._unfinished is not None
            if self._check is not None:
                self._check(self._unfinished.path)
            self._unfinished.move()
        except BaseException:
            self._discard()
            raise
        self._unfinished.discard()

    def _begin(self) -> None:
        """Open the file and write all that is known before the first frame."""
        try:
            self._unfinished = Unfinished(self.path)
            self._disk = GuardedFile(self._unfinished.path)
        except OSError as error:
            raise OSError(
                f"{self.path} could not be written ({error.strerror}); choose another folder."
            ) from error
        self._file = h5py.File(self._disk, "w")
        self._file.attrs.update(self._attributes)
        if not self._motion_only:
            self._vertices = self._create_vertices()
        for name, array in self._arrays.items():
            if isinstance(array, FrameWindows):
                self._create_copied(name, array)
                continue
            data = array.astype(h5py.string_dtype()) if array.dtype.kind == "U" else array
            self._file.create_dataset(name, data=data, **_packing(array))

    def _create_copied(self, name: str, array: FrameWindows) -> None:
        """Make room for an array that is read in stretches; `append` fills it."""
        rows = max(1, min(len(array), _CHUNK_BYTES // max(1, array[:1].nbytes)))
        self._open_file.create_dataset(
            name, array.shape, array.dtype, chunks=(rows, *array.shape[1:]), compression="gzip", shuffle=True
        )
        if self._motion_only:
            self._copy(0, len(array))

    def _copy(self, start: int, stop: int) -> None:
        for name, array in self._arrays.items():
            if isinstance(array, FrameWindows):
                for first in range(start, stop, AT_ONCE):
                    frames = slice(first, min(first + AT_ONCE, stop))
                    self._open_file[name][frames] = array[frames]  # type: ignore[index]  # a dataset

    @property
    def _open_file(self) -> h5py.File:
        assert self._file is not None, "use the writer in a `with` statement"
        return self._file

    def _create_vertices(self) -> h5py.Dataset:
        t, n = self._sizes["t"], self._sizes["n"]
        dtype = np.dtype("f4" if self._scale is None else "i2")
        frames = max(1, min(t, _CHUNK_BYTES // (n * 3 * dtype.itemsize)))
        dataset = self._open_file.create_dataset(
            "vertices", (t, n, 3), dtype, chunks=(frames, n, 3), compression="gzip", shuffle=True
        )
        if self._scale is not None:
            dataset.attrs["scale"] = self._scale
        return dataset

    def _check_frames(self, vertices: np.ndarray, start: int, stop: int) -> None:
        t, n = self._sizes["t"], self._sizes["n"]
        if vertices.ndim != 3 or vertices.shape[1:] != (n, 3):
            raise ValueError(f"{self.path}: vertices have shape {vertices.shape}, expected [k, {n}, 3].")
        if stop > t:
            raise ValueError(f"{self.path}: frame {stop - 1} written, but the motion has {t} frames.")
        bad = ~np.isfinite(vertices).all(axis=(1, 2))
        if bad.any():
            raise ValueError(
                f"{self.path}: vertices of frame {start + int(bad.argmax())} are not finite; nothing was "
                "saved, a clip must be finite throughout."
            )

    def _quantise(self, vertices: np.ndarray, start: int, stop: int, scale: float) -> np.ndarray:
        relative = vertices - self._arrays["root"][start:stop, None]
        steps = np.rint(relative / scale)
        if np.abs(steps).max() > 32_767:
            far = float(np.abs(relative).max())
            raise ValueError(
                f"{self.path}: a vertex is {far:.3f} m from the root, int16 at scale={scale} reaches "
                f"{32_767 * scale:.3f} m; give encoding='float32' or a larger scale."
            )
        return steps.astype(np.int16)

    def _check_complete(self) -> None:
        if not self._motion_only and self._written != self._sizes["t"]:
            raise ValueError(
                f"{self.path}: {self._written} frames written of {self._sizes['t']} in the motion; nothing "
                "was saved, write as many frames as the motion has."
            )

    def _check_disk(self) -> None:
        error = None if self._disk is None else self._disk.error
        if error is not None:
            raise OSError(
                f"{self.path} could not be written ({error.strerror}); nothing was saved, free some space or "
                "choose another folder."
            )

    @uninterrupted()
    def _close(self) -> None:
        if self._file is not None:
            self._file.close()
        if self._disk is not None:
            self._disk.finish()

    @uninterrupted()
    def _discard(self) -> None:
        """Close the file and delete what is not in its place."""
        self._close()
        if self._unfinished is not None:
            self._unfinished.discard()


def _packing(array: np.ndarray) -> dict:
    """Compress what is worth it; an empty dataset cannot be chunked."""
    return {"compression": "gzip", "shuffle": True} if array.size > 64 and array.dtype.kind != "U" else {}
