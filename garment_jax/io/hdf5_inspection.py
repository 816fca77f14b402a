"""What an HDF5 file from a stranger may hold: looked at as a whole before anything of it is read.

HDF5 follows external links, external storage and virtual datasets to any file that the user may read, and
takes the memory that a file asks for. So each file is walked once, through a reader that refuses long pieces,
and what leaves the file or asks for more than the file can hold ends in a sentence.
"""

import math
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import h5py
from h5py import h5a, h5d, h5g, h5l, h5o, h5s, h5t, h5z  # pyright: ignore[reportAttributeAccessIssue]

from garment_jax.io.deferred_errors import uninterrupted

FRAMES = ("vertices", "vertices_delta")  # read by windows, all others whole
_HEAP = b"GCOL\x01"  # how a global heap begins
_LONGEST_PIECE = 4 * 2**20  # bytes of names, links, attributes or text that lie together
_MOST_OBJECTS, _DEEPEST, _LONGEST_NAME = 4096, 8, 255  # this package's files have 20, 2 levels and 24
_MOST_ATTRIBUTES, _LARGEST_ATTRIBUTE, _MOST_TEXTS = 256, 2**16, 64
_LARGEST_TEXT = 4 * 2**20  # characters of a dataset of text
_HARMLESS = 256 * 2**20  # bytes that fit, however densely they are packed
_DENSEST, _DENSEST_FRAMES = 20, 1100  # unpacked bytes a packed byte: more than poses reach; deflate's bound
_MOST_ROWS = 250_000  # two hours of frames; more only where the file has a byte for each
_MOST_PIECES = 2**16  # chunks of a dataset; more only where the file has a byte for each
_LARGEST_CHUNK = 64 * 2**20  # bytes that are unpacked at once
_WINDOW, _LARGEST_SLAB, _MOST_PASSES = 64, 32 * 2**20, 8  # frames read at once, of which chunks are kept
_BUILT_IN = ("DEFLATE", "SHUFFLE", "FLETCHER32", "LZF", "NBIT", "SCALEOFFSET")
_FILTERS = {getattr(h5z, f"FILTER_{name}") for name in _BUILT_IN}
_NUMBERS = (h5t.INTEGER, h5t.FLOAT, h5t.ENUM)


class _Refused(ValueError):
    """A sentence of this file, in distinction from HDF5's own errors."""


class _Data(NamedTuple):
    name: str
    declared: int  # bytes of the values
    stored: int  # bytes in the file


def inspect_hdf5(path: Path) -> None:
    """Raise `ValueError` for an HDF5 file that reaches outside itself or asks for more than it holds.

    External and user-defined links, links to nothing, external storage, virtual datasets, filters and types
    that are not read, too many or too deeply nested objects, long names and texts, sizes far above what is
    stored. What HDF5 cannot read is an `OSError` or another of h5py's errors.
    """
    with _opened(path) as (file, size):
        found = [
            _dataset(data, name, size, path) for data, name in _datasets(file.id, path) if data is not None
        ]
        _attributes(file.id, path)
    whole = [data for data in found if data.name not in FRAMES]
    _check_density(whole, _DENSEST, path)
    _check_density([data for data in found if data.name in FRAMES], _DENSEST_FRAMES, path)


def is_refusal(error: BaseException) -> bool:
    """Return whether an error is a sentence of `inspect_hdf5`, not one of HDF5's own."""
    return isinstance(error, _Refused)


class _Pieces:
    """A file interface for h5py's `fileobj` driver that reads no piece longer than `_LONGEST_PIECE`."""

    def __init__(self, file: Any) -> None:
        self.file = file

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        if len(view) > _LONGEST_PIECE:
            raise _Refused(f"holds names or text of {len(view) / 2**20:.0f} MB in one piece")
        begin = self.file.tell()
        count = self.file.readinto(view) or 0
        self._check_heaps(bytes(view[:count]), begin)
        self.file.seek(begin + count)
        return count

    def _check_heaps(self, piece: bytes, begin: int) -> None:
        """Refuse heaps of text whose entries do not end: HDF5 2.0 reads one of no bytes again and again."""
        at = piece.find(_HEAP)
        while at >= 0:
            self.file.seek(begin + at)
            size = struct.unpack("<8xQ", self.file.read(16).ljust(16, b"\0"))[0]
            if size <= _LONGEST_PIECE:
                self.file.seek(begin + at)
                _check_heap(self.file.read(size))
            at = piece.find(_HEAP, at + 1)

    def read(self, size: int = -1) -> bytes:
        return self.file.read(min(size, _LONGEST_PIECE) if size >= 0 else _LONGEST_PIECE) or b""

    def seek(self, offset: int, whence: int = 0) -> int:
        return self.file.seek(offset, whence)

    def tell(self) -> int:
        return self.file.tell()

    def write(self, data: Any) -> int:
        raise OSError("opened for reading")

    def truncate(self, size: int | None = None) -> int:
        raise OSError("opened for reading")

    def flush(self) -> None:
        """Nothing is written here."""


def _check_heap(heap: bytes) -> None:
    """Walk a global heap as HDF5 does: number, count, bytes, to which only free space adds the head."""
    at = 16
    while at + 16 <= len(heap):
        number, size = struct.unpack_from("<H6xQ", heap, at)
        step = size if number == 0 else 16 + (size + 7) // 8 * 8
        if step < 16 or at + step > len(heap):
            raise OSError("a heap's entry has no end")
        at += step


@contextmanager
def _opened(path: Path) -> Iterator[tuple[h5py.File, int]]:
    """Yield the file, read piece by piece, and its bytes. Ctrl-C waits: h5py loses it inside `readinto`."""
    size = path.stat().st_size
    with uninterrupted(), path.open("rb", buffering=0) as raw, h5py.File(_Pieces(raw), "r") as file:
        try:
            yield file, size
        except _Refused as error:
            if str(error).startswith(str(path)):
                raise
            raise _Refused(f"{path} {error}; export it again.") from error


def _datasets(root: h5g.GroupID, path: Path) -> Iterator[tuple[h5d.DatasetID | None, str]]:
    """Yield every dataset with its name, and None for what is neither dataset nor group."""
    waiting, seen, count = [(root, "", 0)], {h5o.get_info(root).addr}, 0
    while waiting:
        group, above, depth = waiting.pop()
        count += group.get_num_objs()
        if count > _MOST_OBJECTS or depth > _DEEPEST:
            raise _Refused(
                f"{path} holds {f'{count} objects' if count > _MOST_OBJECTS else 'groups deep in groups'}, "
                "more than any clip; export it again."
            )
        for name, kind in _links(group):
            full = _decoded(above, name, path)
            _check_link(kind, full, path)
            info = h5o.get_info(group, name) if kind == h5l.TYPE_HARD else _target(group, name, full, path)
            if info.type == h5o.TYPE_DATASET:
                yield h5d.open(group, name), full
            elif info.type == h5o.TYPE_GROUP and kind == h5l.TYPE_HARD:
                if info.addr in seen:
                    raise _Refused(f"{path}: group {_shown(full)} is linked twice; export it again.")
                seen.add(info.addr)
                waiting.append((h5g.open(group, name), f"{full}/", depth + 1))


def _links(group: h5g.GroupID) -> list[tuple[bytes, int]]:
    found: list[tuple[bytes, int]] = []

    def add(name: bytes, info: h5l.LinkInfo) -> None:
        found.append((name, info.type))

    group.links.iterate(add, info=True)
    return found


def _decoded(above: str, name: bytes, path: Path) -> str:
    if len(name) > _LONGEST_NAME:
        raise _Refused(f"{path} holds a name of {len(name)} bytes; export it again.")
    return above + name.decode(errors="surrogateescape")


def _check_link(kind: int, name: str, path: Path) -> None:
    if kind in (h5l.TYPE_HARD, h5l.TYPE_SOFT):  # soft ones stay within the file
        return
    what = "a link to another file" if kind == h5l.TYPE_EXTERNAL else "a link of a kind of its own"
    raise _Refused(f"{path}: {_shown(name)} is {what}, which is not followed; store the values themselves.")


def _target(group: h5g.GroupID, name: bytes, full: str, path: Path) -> Any:
    """Return what is known of the object that a soft link leads to."""
    try:
        return h5o.get_info(group, name)
    except (KeyError, RuntimeError, OSError) as error:
        raise _Refused(
            f"{path}: {_shown(full)} is a link to nothing; store the values themselves."
        ) from error


def _dataset(data: h5d.DatasetID, name: str, size: int, path: Path) -> _Data:
    """Return what a dataset declares and stores, or refuse how it is stored."""
    where, plan, kind = f"{path}: dataset {_shown(name)}", data.get_create_plist(), data.get_type()
    if plan.get_external_count():
        raise _Refused(f"{where} is stored in another file, which is not read; store the values themselves.")
    if plan.get_layout() == h5d.VIRTUAL:
        raise _Refused(f"{where} is made of other files, which are not read; store the values themselves.")
    filters = [plan.get_filter(i)[0] for i in range(plan.get_nfilters())]
    if len(set(filters)) < len(filters) or not set(filters) <= _FILTERS:
        raise _Refused(f"{where} is packed by filters {filters}; store it with gzip or unpacked.")
    if kind.get_class() not in (*_NUMBERS, h5t.STRING):
        raise _Refused(f"{where} holds neither numbers nor text; store one of them.")
    shape = () if data.get_space().get_simple_extent_type() == h5s.NULL else data.shape
    declared, stored = math.prod(shape) * kind.get_size(), data.get_storage_size()
    if shape and shape[0] > max(_MOST_ROWS, size):
        raise _Refused(f"{where} declares {shape[0]} rows in a file of {size} bytes; export it again.")
    if plan.get_layout() == h5d.CHUNKED:
        _check_chunks(plan.get_chunk(), shape, kind.get_size(), where)
        pieces = math.prod(-(-length // wide) for length, wide in zip(shape, plan.get_chunk(), strict=False))
        if pieces > max(_MOST_PIECES, size):  # each is looked for, also where it is not stored
            raise _Refused(f"{where} declares {pieces} chunks in a file of {size} bytes; export it again.")
    if name in FRAMES:
        _attributes(data, path)
    if isinstance(kind, h5t.TypeStringID) and kind.is_variable_str():
        _check_text(data, shape, where)
        return _Data(name, 0, 0)
    return _Data(name, declared, stored)


def _check_chunks(chunk: tuple[int, ...], shape: tuple[int, ...], item: int, where: str) -> None:
    size = math.prod(chunk) * item
    if size > _LARGEST_CHUNK:
        raise _Refused(
            f"{where} is stored in pieces of {size / 2**20:.0f} MB; store it in chunks of a few frames."
        )
    slab = math.prod([chunk[0], *shape[1:]]) * item
    if slab > _LARGEST_SLAB and min(chunk[0], shape[0]) > _MOST_PASSES * _WINDOW:
        raise _Refused(
            f"{where} is stored in pieces of {chunk[0]} frames; store it in chunks of a few frames."
        )


def _check_text(data: h5d.DatasetID, shape: tuple[int, ...], where: str) -> None:
    """Read a text one entry at a time: each may name the same long piece of the file."""
    if len(shape) > 1 or math.prod(shape) > _MOST_OBJECTS:
        raise _Refused(f"{where} holds texts of shape {shape}; store at most {_MOST_OBJECTS} in a row.")
    found, total = h5py.Dataset(data), 0
    for i in range(math.prod(shape)) if shape else ():
        total += len(found[i])
        if total > _LARGEST_TEXT:
            raise _Refused(f"{where} holds more than {_LARGEST_TEXT // 2**20} MB of text; store names.")


def _attributes(item: h5g.GroupID | h5d.DatasetID, path: Path) -> None:
    """Refuse attributes that are no few numbers or words."""
    if h5a.get_num_attrs(item) > _MOST_ATTRIBUTES:
        raise _Refused(f"{path} holds {h5a.get_num_attrs(item)} attributes; export it again.")
    names: list[bytes] = []
    attributes = (h5py.Dataset if isinstance(item, h5d.DatasetID) else h5py.Group)(item).attrs
    h5a.iterate(item, names.append)
    for name in names:
        attribute = h5a.open(item, name)
        kind, count = attribute.get_type(), attribute.get_space().get_simple_extent_npoints()
        long = isinstance(kind, h5t.TypeVlenID) or kind.detect_class(h5t.VLEN) or _is_text(kind)
        if len(name) > _LONGEST_NAME or count * kind.get_size() > _LARGEST_ATTRIBUTE:
            raise _Refused(f"{path}: attribute {_shown(name.decode(errors='replace'))} is too long.")
        if long and count > _MOST_TEXTS:
            raise _Refused(f"{path}: attribute {_shown(name.decode(errors='replace'))} holds {count} texts.")
        if long:  # its length is only known when it is read
            attributes.get(name)


def _is_text(kind: h5t.TypeID) -> bool:
    return isinstance(kind, h5t.TypeStringID) and bool(kind.is_variable_str())


def _check_density(found: list[_Data], densest: int, path: Path) -> None:
    declared, stored = sum(data.declared for data in found), sum(data.stored for data in found)
    if declared > max(_HARMLESS, densest * stored):
        largest = max(found, key=lambda data: data.declared)
        raise _Refused(
            f"{path}: {_shown(largest.name)} declares {largest.declared / 2**20:.0f} MB and stores "
            f"{largest.stored} bytes; it is damaged, or cut it into clips."
        )


def _shown(name: str) -> str:
    return ascii(name[:80])
