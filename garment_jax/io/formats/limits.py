"""What a file from a stranger may ask for: sizes, archives and shapes, refused before memory is taken."""

import struct
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np

from garment_jax.storage.missing import not_a_file

LARGEST_ARCHIVE = 16 * 2**30  # bytes of a file
LARGEST_ARRAYS = 2 * 2**30  # bytes of the arrays that are read of one file
LONGEST_NUMBER = 64  # characters; what is longer was not written as a number
_DENSEST = 100  # unpacked bytes per packed byte; motion and meshes reach 3, zeros 1,000
_DENSEST_ARCHIVE = (
    16  # the same of an archive: what it unpacks to is in memory before it is known to be wrong
)
_HARMLESS = 64 * 2**20  # unpacked bytes that are too few for a bomb, however dense
_DIRECTORY = 4 * 2**20  # bytes of an archive's directory: tens of thousands of members
_END, _LOCATOR, _END_64 = b"PK\x05\x06", b"PK\x06\x07", b"PK\x06\x06"
_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # the others cannot be unpacked piece by piece


def check_size(path: Path, largest: int, what: str) -> int:
    """Return a file's bytes; `FileNotFoundError` where there is no file, `ValueError` above `largest`.

    `what` is what the user should name, with its article. Devices and pipes are no files: they may never end.
    """
    if not path.is_file():
        raise not_a_file(path, f"name {what}")
    size = path.stat().st_size
    if size > largest:
        raise ValueError(
            f"{path} has {_amount(size)}, more than the {_amount(largest)} that are read; cut it into clips."
        )
    return size


def check_directory(file: BinaryIO, path: Path) -> None:
    """Raise `ValueError` for a zip archive whose directory alone would fill the memory.

    It is read as a whole when the archive is opened. What is no archive passes: opening it will tell.
    """
    size = file.seek(0, 2)
    file.seek(max(size - 2**16 - 100, 0))
    tail = file.read()
    at = tail.rfind(_END)
    if at < 0 or len(tail) < at + 22:
        return
    directory = struct.unpack_from("<I", tail, at + 12)[0]
    if at >= 20 and tail[at - 20 : at - 16] == _LOCATOR:
        file.seek(min(struct.unpack_from("<Q", tail, at - 12)[0], size))
        record = file.read(56)
        if record[:4] == _END_64 and len(record) == 56:
            directory = max(directory, struct.unpack_from("<Q", record, 40)[0])
    if directory > _DIRECTORY:
        raise ValueError(
            f"{path} lists its members in {_amount(directory)}; no archive of arrays needs that."
        )


def check_members(
    members: Sequence[zipfile.ZipInfo], path: Path, *, largest: int = LARGEST_ARCHIVE, size: int
) -> None:
    """Raise `ValueError` for a zip archive of `size` bytes that unpacks to too much, or reaches outside.

    By its directory alone: the sum of the unpacked sizes, their ratio to the packed ones, the names (absolute
    paths, "..", drives), the ways of packing, and members that hold the same bytes twice.
    """
    for member in members:
        _check_name(member.filename, path)
        if member.compress_type not in _PACKINGS or member.flag_bits & 1:
            raise ValueError(
                f"{path}: {_shown(member.filename)} is encrypted or packed unusually; save it again."
            )
    unpacked, packed = sum(m.file_size for m in members), sum(m.compress_size for m in members)
    if packed > size:
        raise ValueError(
            f"{path}: its members claim more bytes than the file has; it is damaged or a zip bomb."
        )
    if unpacked > largest or unpacked > max(_HARMLESS, _DENSEST_ARCHIVE * packed):
        raise ValueError(
            f"{path} would unpack from {_amount(packed)} to {_amount(unpacked)}, as zip bombs do; save its "
            "arrays again without compression."
        )


def check_array(shape: tuple[int, ...], dtype: np.dtype, size: int, name: str, path: Path) -> None:
    """Raise `ValueError` for an array whose shape and type do not make the `size` bytes that are there."""
    count = 1
    for length in shape:
        if length < 0:
            raise ValueError(f"{path}: array {name!r} claims a shape {_short(shape)}; export it again.")
        count *= length  # Python's numbers do not overflow
    if count * dtype.itemsize != size or (count and not dtype.itemsize):
        raise ValueError(
            f"{path}: array {name!r} claims a shape {_short(shape)} of {dtype}, which its {size} bytes do "
            "not fill; export it again."
        )


def check_growth(needed: int, size: int, what: str, path: Path) -> None:
    """Raise `ValueError` where a file of `size` bytes asks for `needed` bytes of memory without holding them.

    For what is multiplied out of a few numbers (joints times frames, faces of corners), before it is made.
    `what` names the numbers: "20,000 joints over 5,000 frames".
    """
    if needed > LARGEST_ARRAYS or needed > max(_HARMLESS, _DENSEST * size):
        raise ValueError(
            f"{path}: {what} would fill {_amount(needed)} from a file of {_amount(size)}; it is damaged, or "
            "cut it into clips."
        )


def _check_name(name: str, path: Path) -> None:
    parts = name.replace("\\", "/").split("/")
    if ".." in parts or parts[0] == "" or ":" in name or "\0" in name:
        raise ValueError(
            f"{path}: member {_shown(name)} points outside the archive, which is refused; save it under a "
            "plain name."
        )


def _shown(name: str) -> str:
    return ascii(name[:80])


def _short(shape: tuple[int, ...]) -> str:
    return str(shape)[:80]


def _amount(size: int) -> str:
    return f"{size / 2**20:.4g} MB" if size >= 2**20 else f"{size} bytes"
