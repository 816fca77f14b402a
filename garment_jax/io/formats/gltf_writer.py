"""Writing a GLB: arrays are streamed to a temporary file, the JSON that describes them comes last."""

import json
import shutil
import struct
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from garment_jax.io.formats.gltf_container import BIN_CHUNK, JSON_CHUNK, MAGIC
from garment_jax.storage.scratch import make_scratch, remove_scratch
from garment_jax.storage.whole import replaced

VERTICES, INDICES = 34962, 34963  # what a buffer view holds for a graphics card; None for anything else
_COMPONENTS = {"u1": 5121, "u2": 5123, "u4": 5125, "f4": 5126}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_LARGEST = 2**32 - 1  # bytes: a GLB counts them in 32 bits


class GlbWriter:
    """A GLB in the making; use it in a `with` statement and end with `finish`.

    The file appears under its name when it is whole; after an error or Ctrl-C nothing is left.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._size = 0

    def add(self, values: np.ndarray, *, target: int | None = None, bounds: bool = False) -> int:
        """Write an array `[count]` or `[count, width]` and return its accessor.

        `target`: VERTICES, INDICES or None. `bounds` stores the least and greatest values, which glTF wants
        of positions and key times. Raises `OSError` when the disk is full, `ValueError` above 4 GB.
        """
        rows = np.ascontiguousarray(values.reshape(len(values), -1))
        kind = rows.dtype.newbyteorder("<")
        view = {"buffer": 0, "byteOffset": self._size, "byteLength": rows.nbytes}
        self._views.append(view | ({} if target is None else {"target": target}))
        accessor = {
            "bufferView": len(self._views) - 1,
            "componentType": _COMPONENTS[kind.str[1:]],
            "count": len(rows),
            "type": _TYPES[rows.shape[1]],
        }
        if bounds:
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self._accessors.append(accessor)
        self._write(rows.astype(kind, copy=False).tobytes())
        return len(self._accessors) - 1

    def finish(self, document: dict[str, Any]) -> int:
        """Put the GLB together, with `document` as its JSON, and return its size in bytes."""
        document = {
            **document,
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": self._size}],
        }
        text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + self._size
        self._check_size(total)
        try:
            self._file.close()
            with replaced(self.path) as (made,), self._parts.open("rb") as parts, made.open("wb") as whole:
                whole.write(struct.pack("<5I", MAGIC, 2, total, len(text), JSON_CHUNK))
                whole.write(text + struct.pack("<2I", self._size, BIN_CHUNK))
                shutil.copyfileobj(parts, whole, 2**20)
        except OSError as error:
            raise self._failure(error) from error
        return total

    def __enter__(self) -> "GlbWriter":
        try:
            self._scratch = make_scratch(self.path.parent)
            self._parts = self._scratch / "arrays"
            self._file = self._parts.open("wb")
        except OSError as error:
            raise self._failure(error) from error
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._file.close()
        except OSError as failure:
            if error is None:
                raise self._failure(failure) from failure
        finally:
            remove_scratch(self._scratch)

    def _write(self, data: bytes) -> None:
        data += bytes(-len(data) % 4)  # every array begins at a multiple of 4
        self._check_size(self._size + len(data))
        try:
            self._file.write(data)
        except OSError as error:
            raise self._failure(error) from error
        self._size += len(data)

    def _check_size(self, size: int) -> None:
        if size > _LARGEST:
            raise ValueError(
                f"{self.path} would exceed 4 GB, the most that a GLB can have; write fewer frames."
            )

    def _failure(self, error: OSError) -> OSError:
        return OSError(
            f"{self.path} could not be written ({error.strerror}); nothing was saved, free some space or "
            "choose another folder."
        )
