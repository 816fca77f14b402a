"""Who writes: a process, told from a later one of the same number."""

import os
import re
import socket
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

_GONE = "ZX"  # states of a process that has ended: its parent has not asked for it yet


class Process(NamedTuple):
    """A process of some machine."""

    pid: int
    started: int  # clock ticks after the machine's start; 0 where the system does not tell
    host: str  # the machine's name, and whose process numbers these are: containers have their own


def this_process() -> Process:
    """Return the process that calls."""
    return Process(os.getpid(), _started(os.getpid()) or 0, _host())


def is_dead(process: Process) -> bool:
    """Return whether a process has ended: it was one of this machine, and its number is free or another's.

    Of other machines nothing is known, so theirs are alive.
    """
    if process.host != _host() or os.name != "posix":
        return False
    if Path("/proc/self/stat").exists():
        return _started(process.pid) != process.started
    try:
        os.kill(process.pid, 0)
    except ProcessLookupError:
        return True
    except OSError:  # another user's
        return False
    return False


def _started(pid: int) -> int | None:
    """Return when a process was started; None where it has ended or the system does not tell."""
    try:
        facts = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    state, *numbers = facts.rpartition(")")[2].split()  # its name, in parentheses, may hold anything
    return None if state in _GONE else int(numbers[18])


@lru_cache(maxsize=1)
def _host() -> str:
    name = re.sub(r"[^A-Za-z0-9.]", "_", socket.gethostname())[:64] or "unknown"
    try:
        return f"{name}_{os.stat('/proc/self/ns/pid').st_ino}"
    except OSError:
        return name
