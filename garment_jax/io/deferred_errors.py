"""A file for HDF5 to write to that survives a full disk and Ctrl-C.

HDF5 1.14 and 2.0 cannot close a file whose writes fail: objects stay open and the process ends with a
segmentation fault at exit. So the failure is kept from it: the first failed write is remembered here,
all later ones are dropped, and the owner asks `error` before it calls the file good.

Nor can it pass on an exception that Ctrl-C raises within one of these methods: it went on without what was
to be written, or crashed. So every call of HDF5 that may write is made within `uninterrupted`.
"""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold Ctrl-C back until the block ends; then it does what it would have done.

    So with SIGTERM and SIGHUP, where they raise. On another thread than the main one nothing is held back:
    signals never come there.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    seen: list[tuple[int, Any]] = []
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    held = {number: does for number, does in before.items() if callable(does)}
    for number in held:
        signal.signal(number, lambda *at: seen.append(at))
    try:
        yield
    finally:
        for number, does in held.items():
            signal.signal(number, does)
        if seen:
            held[seen[0][0]](*seen[0])


class GuardedFile:
    """The file interface that h5py's `fileobj` driver needs; new file, opened for reading and writing.

    Buffers are whatever h5py hands over: its Cython memory views are no `memoryview`.
    """

    def __init__(self, path: Path) -> None:
        self.error: OSError | None = None
        self._raw = open(path, "w+b", buffering=0)  # noqa: SIM115 - lives as long as the HDF5 file

    def write(self, data: Any) -> int:
        """Write all of `data`, or remember why that failed and claim that it worked."""
        view = memoryview(data).cast("B")
        done = 0
        while done < len(view) and self.error is None:
            try:
                done += self._raw.write(view[done:]) or 0
            except OSError as error:
                self.error = error
        if self.error is not None:
            self._raw.seek(len(view) - done, os.SEEK_CUR)
        return len(view)

    def readinto(self, buffer: Any) -> int:
        """Fill the whole `buffer`: what was dropped reads as zeros."""
        view = memoryview(buffer).cast("B")
        count = self._raw.readinto(view) or 0
        view[count:] = bytes(len(view) - count)
        return len(view)

    def read(self, size: int = -1) -> bytes:
        return self._raw.read(size) or b""

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return self._raw.seek(offset, whence)

    def tell(self) -> int:
        return self._raw.tell()

    def truncate(self, size: int | None = None) -> int:
        """Cut or extend the file; extending can fail like a write."""
        if self.error is None:
            try:
                return self._raw.truncate(size)
            except OSError as error:
                self.error = error
        return self._raw.tell() if size is None else size

    def flush(self) -> None:
        """Nothing is buffered here."""

    def finish(self) -> None:
        """Force everything to the disk and close; the error, if there was one, is in `error`."""
        if self._raw.closed:
            return
        try:
            if self.error is None:
                os.fsync(self._raw.fileno())
        except OSError as error:
            self.error = error
        finally:
            self._raw.close()
