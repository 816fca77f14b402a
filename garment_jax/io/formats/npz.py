"""Archives of plain arrays (.npz): names, shapes and arrays, nothing believed that the bytes do not hold."""

import errno
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from garment_jax.io.formats.limits import (
    LARGEST_ARCHIVE,
    LARGEST_ARRAYS,
    check_array,
    check_directory,
    check_members,
    check_size,
)

_BLOCK = 2**20  # bytes read at once
_READERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
_BROKEN = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    SyntaxError,
    TypeError,
    KeyError,
    OverflowError,
    NotImplementedError,
    RuntimeError,
    UnicodeError,
    struct.error,
)


class _Header(NamedTuple):
    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype


class Damaged(Exception):
    """The archive or an array's header cannot be read."""


def npz_names(path: str | Path) -> tuple[str, ...]:
    """Return the names of an archive's arrays; raises as `read_npz`."""
    with _opened(Path(path)) as archive:
        return tuple(_arrays(archive))


def npz_shapes(path: str | Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of an archive's arrays by name, their values unread; raises as `read_npz`."""
    shapes = {}
    with _opened(Path(path)) as archive:
        for name, member in _arrays(archive).items():
            with cast(zipfile.ZipExtFile, archive.open(member)) as file:
                shapes[name] = _header(file).shape
    return shapes


def read_npz(
    path: str | Path, names: Iterable[str] | None = None, *, largest: int = LARGEST_ARRAYS
) -> dict[str, np.ndarray]:
    """Return those of the named arrays that an archive holds (all by default).

    Raises `FileNotFoundError`, `OSError` for a damaged file, `ValueError` for pickled objects (reading them
    would run whatever they say), for zip bombs, names that point outside the archive, shapes that the bytes
    do not fill and arrays of more than `largest` bytes together.
    """
    path = Path(path)
    found = {}
    with _opened(path) as archive:
        members = _arrays(archive)
        for name in members if names is None else names:
            if name in members:
                found[name] = _read(archive, members[name], name, path, largest)
                largest -= found[name].nbytes
    return found


@contextmanager
def _opened(path: Path) -> Iterator[zipfile.ZipFile]:
    size = check_size(path, LARGEST_ARCHIVE, "an .npz file")
    try:
        with path.open("rb") as raw:
            check_directory(raw, path)
            with zipfile.ZipFile(raw) as archive:
                check_members(archive.infolist(), path, size=size)
                yield archive
    except (Damaged, *_BROKEN) as error:
        raise OSError(f"{path} is damaged or no .npz file of plain arrays; copy it again.") from error
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
        # a directory that begins before the file does
        raise OSError(f"{path} is damaged or no .npz file of plain arrays; copy it again.") from error


def _arrays(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """Return the members that are arrays, under their names."""
    return {
        member.filename.removesuffix(".npy"): member
        for member in archive.infolist()
        if member.filename.endswith(".npy")
    }


def _read(
    archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str, path: Path, largest: int
) -> np.ndarray:
    with cast(zipfile.ZipExtFile, archive.open(member)) as file:
        header = _header(file)
        if header.dtype.subdtype is not None:
            raise ValueError(
                f"{path}: array {name!r} is an array of arrays; store it as plain numbers or text."
            )
        if header.dtype.hasobject:
            raise ValueError(
                f"{path}: array {name!r} holds pickled Python objects, which are not read; store it as plain "
                "numbers or text."
            )
        check_array(header.shape, header.dtype, member.file_size - file.tell(), name, path)
        size = member.file_size - file.tell()
        if size > largest:
            raise ValueError(
                f"{path}: array {name!r} has {size / 2**20:.0f} MB, too much together with what was read "
                "before it; cut the file into clips."
            )
        flat = _filled(file, size, header.dtype)
    return flat.reshape(header.shape, order="F" if header.fortran else "C")


def _header(file: zipfile.ZipExtFile) -> _Header:
    try:
        reader = _READERS[np.lib.format.read_magic(file)]
        return _Header(*reader(file))
    except (ValueError, MemoryError, RecursionError, tokenize.TokenError) as error:
        raise Damaged from error


def _filled(file: zipfile.ZipExtFile, size: int, dtype: np.dtype) -> np.ndarray:
    """Return the `size` bytes that follow; read in pieces, so that they are there once only."""
    raw = bytearray(size)
    view, at = memoryview(raw), 0
    while at < size:
        piece = file.read(min(_BLOCK, size - at))
        if not piece:
            raise Damaged
        view[at : at + len(piece)] = piece
        at += len(piece)
    if file.read(1):  # reaching the end is what checks the sum
        raise Damaged
    return np.frombuffer(raw, dtype) if size else np.zeros(0, dtype)
