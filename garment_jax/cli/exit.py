"""The end of the process: after Ctrl-C at once, whatever is being compiled; what is half written goes first.

SIGTERM (`docker stop`, SLURM, `timeout`) and SIGHUP end a command as Ctrl-C does; Python would die of them on
the spot. The exception that a signal raises gets lost in what C calls back, and breaks a package that is
being imported: so it waits for the import to end, and is raised again where it was lost.
"""

import _thread
import multiprocessing
import os
import signal
import sys
import threading
import time
from contextlib import suppress
from types import FrameType
from typing import Any, NoReturn

INTERRUPTED = 130  # 128 + SIGINT, as shells have it
_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
_ONE = 1.0  # seconds in which several signals are one: `timeout` sends it to the process and to its group
_PAUSE = 0.1  # seconds until a signal is raised again
_HERE = os.path.dirname(__file__)


class _Asked:
    """The signal that has asked this process to end."""

    number = 0
    at = 0.0
    again = False  # it comes once more


def listen() -> None:
    """Let the signals that ask a process to end raise `KeyboardInterrupt`; a second one ends it at once.

    Those that are ignored stay so (`nohup`).
    """
    for number in _SIGNALS:
        if signal.getsignal(number) not in (signal.SIG_IGN, None):
            signal.signal(number, _ask)
    sys.unraisablehook = _swallowed


def stopped() -> int:
    """Return the exit code of the signal that has asked this process to end; 0 where none has."""
    return _Asked.number and 128 + _Asked.number


def leave(code: int) -> NoReturn:
    """End the process with `code`.

    An interpreter that ends waits for its threads, and one inside XLA's compiler cannot be stopped: up to a
    minute. All files are closed and all temporary ones gone when `code` says that the user interrupted.
    """
    if code in (INTERRUPTED, stopped() or INTERRUPTED):
        for worker in multiprocessing.active_children():  # of a pool whose end a second Ctrl-C cut short
            worker.terminate()
        with suppress(OSError, ValueError):  # closed, or nobody reads
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)
    for number in _SIGNALS:
        if signal.getsignal(number) is _ask:
            signal.signal(
                number, lambda number, frame: os._exit(128 + number)
            )  # while threads are waited for
    sys.exit(code)


def _ask(number: int, frame: FrameType | None) -> None:
    again, _Asked.again = _Asked.again, False
    if _Asked.number and not again:
        if time.monotonic() - _Asked.at > _ONE:
            leave(stopped())
        return
    if not again:
        _Asked.number, _Asked.at = number, time.monotonic()
        if number != signal.SIGINT:  # which a terminal sends to all processes
            for worker in multiprocessing.active_children():
                with suppress(OSError):
                    os.kill(worker.pid or 0, signal.SIGINT)
    importer = _importer(frame)
    if os.path.dirname(importer) == _HERE:  # a command imports what it uses: nothing is open yet
        os.write(2, b"interrupted\n")
        os._exit(stopped())
    if importer:
        _raise_soon()
    else:
        raise KeyboardInterrupt


def _importer(frame: FrameType | None) -> str:
    """Return the file with the outermost import that is under way at `frame`; "" where none is."""
    found, importing = "", False
    while frame is not None:
        name = frame.f_code.co_filename
        if not name.startswith("<frozen importlib") and importing:
            found = name
        importing = name.startswith("<frozen importlib")
        frame = frame.f_back
    return found


def _raise_soon() -> None:
    _Asked.again = True

    def send() -> None:
        time.sleep(_PAUSE)
        if hasattr(signal, "pthread_kill"):
            signal.pthread_kill(threading.main_thread().ident or 0, _Asked.number)
        else:  # Windows
            signal.raise_signal(_Asked.number)

    _thread.start_new_thread(send, ())  # `threading` takes a lock, which the interrupted code may hold


def _swallowed(unraisable: Any) -> None:
    """Raise the signal again that was lost in what cannot raise: `__del__`, a callback of the collector."""
    if issubclass(unraisable.exc_type, KeyboardInterrupt) and _Asked.number:
        _raise_soon()
    else:
        sys.__unraisablehook__(unraisable)
