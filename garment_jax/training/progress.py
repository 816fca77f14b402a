"""The progress line on stderr: rewritten in place on a terminal, a line now and then elsewhere."""

import sys
import time
from typing import Any

_LINE_SECONDS = 10.0  # between lines where a carriage return would not overwrite


class Progress:
    """Prints stage, step, speed, time left and loss to a text stream (stderr by default).

    The speed counts the steps of this process only.
    """

    def __init__(
        self, stage: str, *, start: int, steps: int, frames_per_step: int = 0, stream: Any = None
    ) -> None:
        self._stage, self._start, self._steps = stage, start, steps
        self._frames = frames_per_step
        self._stream = stream or sys.stderr
        self._began = time.monotonic()
        self._printed = -_LINE_SECONDS
        self._open_line = False

    def show(self, step: int, loss: float, *, last: bool = False) -> None:
        """Report that `step` steps are done; `last` prints whatever the time since the last line."""
        now = time.monotonic()
        terminal = self._stream.isatty()
        if not (terminal or last) and now - self._printed < _LINE_SECONDS:
            return
        self._printed = now
        text = self._line(step, loss, max(now - self._began, 1e-9))
        self._stream.write(f"\r{text:<78}" if terminal else text + "\n")
        self._open_line = terminal
        self._stream.flush()

    def close(self) -> None:
        """End a line that a carriage return left open, so that what follows begins on its own."""
        if self._open_line:
            self._stream.write("\n")
            self._open_line = False

    def _line(self, step: int, loss: float, seconds: float) -> str:
        speed = (step - self._start) / seconds  # steps a second
        rate = f"{speed * self._frames:.0f} frames/s" if self._frames else f"{speed:.1f} steps/s"
        left = duration((self._steps - step) / speed) if speed > 0 else "?"
        return f"{self._stage}  {step}/{self._steps}  {rate}  {left} left  loss {loss:.4g}"


def duration(seconds: float) -> str:
    """`m:ss` below an hour, `h:mm:ss` from there."""
    whole = round(seconds)
    minutes, rest = divmod(whole, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
