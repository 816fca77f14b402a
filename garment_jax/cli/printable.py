"""What reaches the terminal: names of clips and files as text that shows, whatever is in them.

A clip's name comes from a stranger and may hold escape codes that rewrite the screen; a file's name may be no
UTF-8; a terminal may know ASCII only. All that is printed passes here, so that no command need think of it.
"""

import os
import re
import sys
import warnings
from typing import Any

# all control codes but line ends, tabs and the return with which a line of progress begins
_CODES = "\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f"
_DIRECTIONS = "\u200e\u200f\u202a-\u202e\u2066-\u2069"  # they turn the order of the letters after them
_CONTROL = re.compile(f"[{_CODES}{_DIRECTIONS}]|(?<=[^\n])\r(?!\n|$)")


def printable(text: str) -> str:
    """Return the text with control codes spelt out: `\\x1b` for an escape."""
    return _CONTROL.sub(lambda found: ascii(found[0])[1:-1], text)


class _Shown:
    """A text stream that writes what is printable and passes all else on.

    Where nobody reads any more (head, less), or a disk is full, the work goes on without a word.
    """

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self.lost = ""  # why what was written is not there, of those who would want it

    def write(self, text: str) -> int:
        try:
            return self._stream.write(printable(text))
        except OSError as error:
            self._fall_silent(error)
            return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError as error:
            self._fall_silent(error)

    def _fall_silent(self, error: OSError) -> None:
        """Let all that is still to come, and what waits in the stream, go nowhere."""
        if not isinstance(error, BrokenPipeError):
            self.lost = self.lost or error.strerror or str(error)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)

    def writelines(self, lines: Any) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def show_safely() -> None:
    """Make stdout and stderr take any text; libraries' warnings are for those who ask for them."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None or isinstance(stream, _Shown):
            continue
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
        setattr(sys, name, _Shown(stream))
    if not sys.warnoptions:  # neither -W nor PYTHONWARNINGS
        warnings.simplefilter("ignore")


def all_said(code: int) -> int:
    """Return the exit code: `code`, or 2 where standard output has lost what was printed, which is said."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    lost = getattr(sys.stdout, "lost", "")
    if lost:
        print(f"error: standard output was not written ({lost}); send it elsewhere.", file=sys.stderr)
    return max(code, 2) if lost else code
