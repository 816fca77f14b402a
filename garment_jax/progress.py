"""How far a clip is, in frames, on stderr: one line rewritten on a terminal, one now and then elsewhere."""

import sys
import time
from types import TracebackType
from typing import Any

_TERMINAL_SECONDS = 0.3  # between prints; the eye needs no more
_LINE_SECONDS = 30.0  # between lines of a log file: a night's simulation stays readable


class FrameProgress:
    """Prints frames done of all, frames a second and seconds left, since it was made.

    Use it in a `with` statement, which clears the line, so that what is printed next begins on a clean one.
    """

    def __init__(self, name: str, *, stream: Any = None) -> None:
        self._name = name
        self._stream = stream or sys.stderr
        self._terminal = self._stream.isatty()
        self._began = self._printed = time.monotonic()
        self._width = 0  # of what stands on the terminal's line

    def __call__(self, done: int, total: int) -> None:
        """Report that `done` frames (more than 0) of `total` are there."""
        now = time.monotonic()
        if now - self._printed < (_TERMINAL_SECONDS if self._terminal else _LINE_SECONDS):
            return
        self._printed = now
        rate = done / (now - self._began)
        left = (total - done) / rate
        self._write(f"{self._name}: {done}/{total} frames, {rate:.1f} frames/s, {left:.0f} s left")

    def say(self, text: str) -> None:
        """Show on a terminal what is done before the first frame."""
        if self._terminal:
            self._write(f"{self._name}: {text}")

    def __enter__(self) -> "FrameProgress":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._width:
            self._stream.write(f"\r{'':<{self._width}}\r")
            self._stream.flush()

    def _write(self, text: str) -> None:
        if self._terminal:
            self._width = max(self._width, len(text))
            text = f"\r{text:<{self._width}}"
        else:
            text += "\n"
        self._stream.write(text)
        self._stream.flush()
