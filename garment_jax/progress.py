"""How far a clip or a training is, on stderr: one line rewritten on a terminal, one now and then elsewhere.

Nobody is left to wonder for longer than two seconds what the computer does.

tqdm and rich were weighed and left: what they draw in a log file is one line per update.
"""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import TracebackType
from typing import Any

_TERMINAL_SECONDS = 0.3  # between prints; the eye needs no more
_LINE_SECONDS = 30.0  # between lines of a log file: a night's simulation stays readable
_FIRST_SECONDS = 2.0  # before the first of these lines
_SAID_SECONDS = 1.0  # what is over sooner a log file need not say; on a terminal, its clock's tick
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
        self._began = time.monotonic()
        wait = _TERMINAL_SECONDS if self._terminal else _FIRST_SECONDS
        self._next = self._began + wait  # when a line may be printed
        self._width = 0  # of what stands on the terminal's line
        self._lock = threading.Lock()  # held while the stream is written to, by this thread or the clock's
        self._over = threading.Event()  # what was said last is over
        self._said = False  # and no frame has come since

    def __call__(self, done: int, total: int, *, note: str = "", last: bool = False) -> None:
        """Report that `done` (more than `start`) of `total` are there; `last` prints at any time.

        The first frames after something was said took its time: the speed is that of the others.
        """
        if self._said and not last:
            self.begin(done)
            return
        now = time.monotonic()
        if not last and now < self._next:
            return
        self._next = now + (_TERMINAL_SECONDS if self._terminal else _LINE_SECONDS)
        speed = (done - self._start) / max(now - self._began, 1e-9)
        rate = f"{speed * self._frames:.0f} frames/s" if self._frames else f"{speed:.1f} {self._unit}/s"
        left = (total - done) / speed
        parts = [f"{self._name}: {done}/{total} {self._unit}", rate, f"{duration(left)} left"]
        whole = _WHOLE.get()
        all_left = "" if whole is None else whole(self._name, left)
        self._write(", ".join([*parts, *filter(None, [note, all_left])]))

    def begin(self, done: int) -> None:
        """Count the speed from here, where `done` are there: those took the time of compiling."""
        self._end_said()
        self._said = False
        self._start, self._began = done, time.monotonic()
        if self._terminal:
            self._write(f"{self._name}: {done} {self._unit}")

    def say(self, text: str) -> None:
        """Show what is done before the first frame: at once, with a clock, on a terminal.

        Elsewhere as one line, unless it is over at once.
        """
        self._end_said()
        self._over, self._said = threading.Event(), True
        if self._terminal:
            self._write(f"{self._name}: {text}")
        threading.Thread(target=self._repeat, args=(text, self._over), daemon=True).start()

    def _repeat(self, text: str, over: threading.Event) -> None:
        began = time.monotonic()
        while not over.wait(_SAID_SECONDS):
            clock = f", {duration(time.monotonic() - began)}" if self._terminal else ""
            with self._lock:
                if not over.is_set():
                    self._put(f"{self._name}: {text}{clock}")
            if not self._terminal:
                return

    def _end_said(self) -> None:
        with self._lock:  # from here on the clock writes nothing
            self._over.set()

    def __enter__(self) -> "FrameProgress":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.clear()

    def clear(self) -> None:
        """Leave a clean line on a terminal."""
        self._end_said()
        if self._width:
            self._stream.write(f"\r{'':<{self._width}}\r")
            self._stream.flush()
            self._width = 0

    def _write(self, text: str) -> None:
        with self._lock:
            self._put(text)

    def _put(self, text: str) -> None:
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
