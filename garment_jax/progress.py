"""How far a clip or a training is, on stderr: one line rewritten on a terminal, one now and then elsewhere.

tqdm and rich were weighed and left: what they draw in a log file is one line per update.
"""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import TracebackType
from typing import Any

_TERMINAL_SECONDS = 0.3  # between prints; the eye needs no more
_LINE_SECONDS = 30.0  # between lines of a log file: a night's simulation stays readable
Whole = Callable[[str, float], str]  # (name, seconds left of that) -> what is left of everything
_WHOLE: ContextVar[Whole | None] = ContextVar("whole", default=None)


@contextmanager
def part_of_whole(left: Whole) -> Iterator[None]:
    """Let every line of progress inside end with what `left` says of the work that it is a part of."""
    token = _WHOLE.set(left)
    try:
        yield
    finally:
        _WHOLE.reset(token)


class FrameProgress:
    """Prints what is done of all, its speed and the time left, since it was made.

    Use it in a `with` statement, which clears the line, so that what is printed next begins on a clean one.
    It counts frames, or training steps of `frames_per_step` frames (`unit="steps"`) of which `start` were
    done before: the speed is this process' own.
    """

    def __init__(
        self,
        name: str,
        *,
        unit: str = "frames",
        start: int = 0,
        frames_per_step: int = 0,
        stream: Any = None,
    ) -> None:
        self._name, self._unit, self._start, self._frames = name, unit, start, frames_per_step
        self._stream = stream or sys.stderr
        self._terminal = self._stream.isatty()
        self._began = self._printed = time.monotonic()
        self._width = 0  # of what stands on the terminal's line

    def __call__(self, done: int, total: int, *, note: str = "", last: bool = False) -> None:
        """Report that `done` (more than `start`) of `total` are there; `last` prints at any time."""
        now = time.monotonic()
        if not last and now - self._printed < (_TERMINAL_SECONDS if self._terminal else _LINE_SECONDS):
            return
        self._printed = now
        speed = (done - self._start) / max(now - self._began, 1e-9)
        rate = f"{speed * self._frames:.0f} frames/s" if self._frames else f"{speed:.1f} {self._unit}/s"
        left = (total - done) / speed
        parts = [f"{self._name}: {done}/{total} {self._unit}", rate, f"{duration(left)} left"]
        whole = _WHOLE.get()
        all_left = "" if whole is None else whole(self._name, left)
        self._write(", ".join([*parts, *filter(None, [note, all_left])]))

    def begin(self, done: int) -> None:
        """Count the speed from here, where `done` are there: those took the time of compiling."""
        self._start, self._began = done, time.monotonic()

    def say(self, text: str) -> None:
        """Show on a terminal what is done before the first frame."""
        if self._terminal:
            self._write(f"{self._name}: {text}")

    def __enter__(self) -> "FrameProgress":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.clear()

    def clear(self) -> None:
        """Leave a clean line on a terminal."""
        if self._width:
            self._stream.write(f"\r{'':<{self._width}}\r")
            self._stream.flush()
            self._width = 0

    def _write(self, text: str) -> None:
        if self._terminal:
            self._width = max(self._width, len(text))
            text = f"\r{text:<{self._width}}"
        else:
            text += "\n"
        self._stream.write(text)
        self._stream.flush()


def duration(seconds: float) -> str:
    """`m:ss` below an hour, `h:mm:ss` from there."""
    whole = round(seconds)
    minutes, rest = divmod(whole, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
