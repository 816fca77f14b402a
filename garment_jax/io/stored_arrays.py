"""Large arrays on disk, filled by windows of frames and memory-mapped: whole and proven, or not there.

Beside `NAME.npy` lies `NAME.npy.sha256`, the digest of the values as they were handed over. What is found is
used only where its values still have that digest: a file that a killed process or a full disk left with
frames of zeros is made anew. That costs 0.7 s for each GB, less than the statistics that read it next.
"""

import errno
import hashlib
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from garment_jax.storage.whole import replaced

_BLOCK = 2**24  # bytes hashed at once


def digest_path(path: Path) -> Path:
    """Return where the digest of the array at `path` is stored."""
    return path.with_name(f"{path.name}.sha256")


class StoredArray:
    """A new float32 array in a file, written in order from its first frame on."""

    def __init__(self, path: Path, shape: tuple[int, ...]) -> None:
        self._values = _reserved(path, shape)
        self._digest = hashlib.sha256()
        self._begin, self._last = 0, self._values[:0]  # the window written last, whose digest waits

    def write(self, start: int, values: np.ndarray) -> None:
        """Write a window, the frames from `start` on, `[k, ...]`.

        It follows the one before, or begins within it and then has the last word.
        """
        self._values[start : start + len(values)] = values
        self._digest.update(self._last[: start - self._begin].data)
        self._begin, self._last = start, np.ascontiguousarray(values, np.float32)

    def finish(self) -> str:
        """Bring everything to the disk and return the digest of all frames."""
        written = self._begin + len(self._last)
        assert written == len(self._values), f"{written} of {len(self._values)} frames are written"
        self._digest.update(self._last.data)
        self._values.flush()
        return self._digest.hexdigest()


@contextmanager
def stored_arrays(names: Mapping[str, Path], shape: tuple[int, ...]) -> Iterator[dict[str, StoredArray]]:
    """Give an array to fill for each of `names`, files of one folder; they appear when all are filled.

    Raises `OSError` where the disk has no room for them.
    """
    paths = list(names.values())
    digests = [digest_path(path) for path in paths]
    with replaced(*paths, *digests, last=digests) as made:
        arrays = {part: StoredArray(path, shape) for part, path in zip(names, made, strict=False)}
        yield arrays
        for path, array in zip(made[len(paths) :], arrays.values(), strict=True):
            path.write_text(array.finish() + "\n", encoding="utf-8")


def stored_array(path: Path, shape: tuple[int, ...]) -> np.ndarray | None:
    """Return an array of the cache, memory-mapped; None where it is not there, or not as it was written."""
    try:
        array = np.load(path, mmap_mode="r")
        wanted = digest_path(path).read_text(encoding="utf-8").strip()
    except (OSError, ValueError, EOFError):
        return None
    if array.shape != shape or array.dtype != np.float32:
        return None
    return array if _digest(array) == wanted else None


def _digest(array: np.ndarray) -> str:
    digest, rows = hashlib.sha256(), max(_BLOCK // max(array[:1].nbytes, 1), 1)
    for start in range(0, len(array), rows):
        digest.update(np.ascontiguousarray(array[start : start + rows]).data)
    return digest.hexdigest()


def _reserved(path: Path, shape: tuple[int, ...]) -> np.memmap:
    """Return a new array in a file that has its room on the disk: a full one ends the process at a write."""
    try:
        array = np.lib.format.open_memmap(path, "w+", np.float32, shape)
        _reserve(path)
    except OSError as error:
        raise OSError(
            f"the prepared clips could not be written to {path.parent.parent} ({error.strerror}); free some "
            "space or choose another --run-dir."
        ) from error
    return array


def _reserve(path: Path) -> None:
    """Ask for a file's room on the disk, where the system and the disk know how to."""
    if not hasattr(os, "posix_fallocate"):
        return
    with path.open("r+b") as file:
        try:
            os.posix_fallocate(file.fileno(), 0, path.stat().st_size)
        except OSError as error:
            if error.errno not in (errno.EOPNOTSUPP, errno.EINVAL):
                raise
