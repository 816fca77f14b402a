"""An array over the frames of a motion that stays where it is stored and is read a stretch at a time."""

from collections.abc import Callable, Iterator
from threading import Lock

import numpy as np

AT_ONCE = 1024  # frames in memory: what a frame takes for its neighbours is nearly always there
_KEPT = 2  # stretches: a reader that lags behind another does not throw its stretch out


class FrameWindows:
    """Frames `[t, ...]` behind a function that reads some of them; slices like an array.

    `windows[start:stop]` and `windows[start:stop, ...]` are arrays, and `np.asarray(windows)` reads all. In
    the place of a `Motion`'s rotations it keeps a long motion out of memory. Reading is safe from several
    threads. `read(start, stop)` returns `[stop - start, ...]`, or raises what the source raises.
    """

    def __init__(self, read: Callable[[int, int], np.ndarray], shape: tuple[int, ...], dtype: str) -> None:
        self.read = read
        self.shape, self.dtype = shape, np.dtype(dtype)
        self._kept: dict[int, np.ndarray] = {}
        self._lock = Lock()

    @property
    def ndim(self) -> int:
        return len(self.shape)

    @property
    def size(self) -> int:
        return int(np.prod(self.shape))

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: slice | tuple) -> np.ndarray:
        frames, *others = key if isinstance(key, tuple) else (key,)
        if not isinstance(frames, slice) or frames.step not in (None, 1):
            raise TypeError(f"frames {frames!r} are no stretch; give start:stop, or np.asarray(...) first.")
        start, stop, _ = frames.indices(len(self))
        first = start - start % AT_ONCE
        parts = [self._stretch(k)[max(start - k, 0) : stop - k] for k in range(first, stop, AT_ONCE)]
        if not parts or stop <= start:
            found = np.zeros((0, *self.shape[1:]), self.dtype)
        else:
            found = parts[0] if len(parts) == 1 else np.concatenate(parts)
        return found[(slice(None), *others)]

    def __array__(self, dtype: np.dtype | None = None, copy: bool | None = None) -> np.ndarray:
        whole = np.asarray(self.read(0, len(self)), self.dtype)
        return whole if dtype is None else whole.astype(dtype, copy=False)

    def _stretch(self, first: int) -> np.ndarray:
        with self._lock:
            if first not in self._kept:
                if len(self._kept) == _KEPT:
                    self._kept.pop(next(iter(self._kept)))  # the oldest
                read = self.read(first, min(first + AT_ONCE, len(self)))
                self._kept[first] = np.asarray(read, self.dtype)
            return self._kept[first]


def first_frames(x: np.ndarray | FrameWindows, frames: int) -> np.ndarray | FrameWindows:
    """Return the first `frames` of `x` `[t, ...]`; what stays where it is stored, still does."""
    if isinstance(x, FrameWindows):
        return FrameWindows(x.read, (min(frames, len(x)), *x.shape[1:]), x.dtype.str)
    return x[:frames]


def stretches(frames: int, *, before: int = 0) -> Iterator[tuple[int, slice]]:
    """Yield stretches of `AT_ONCE` frames: how many of the slice go before, and the slice with them.

    `before`: frames that each stretch needs of the one before it; the first has none.
    """
    for start in range(0, frames, AT_ONCE):
        first = max(start - before, 0)
        yield start - first, slice(first, min(start + AT_ONCE, frames))
