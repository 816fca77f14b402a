"""Commands run in forks: their file operations are counted, and each can be stopped at or killed before."""

import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from tests.fuzz.command_lines import run_words
from tests.fuzz.writing_commands import Command

WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT
CHANGING = ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.truncate")


class Ended(NamedTuple):
    """How a run ended."""

    code: int  # negative: the signal
    said: str  # on stderr
    operations: int  # file operations up to its end


def run(command: Command, folder: Path, *, kill_at: int = 0) -> Ended:
    """Run a command in `folder`, in a fork; signal 9 comes before its operation of the number `kill_at`."""
    child, said = start(command, folder, kill_at=kill_at)
    return finish(child, said)


def run_stopping(command: Command, folder: Path, stopped: Callable[[int], None]) -> Ended:
    """Run a command and call `stopped` with the number of each file operation, just before it.

    All threads of the command stand still meanwhile, so `folder` is what signal 9 would leave there.
    """
    child, said = start(command, folder, stopping=True)
    number = 0
    while os.WIFSTOPPED(status := os.waitpid(child, os.WUNTRACED)[1]):
        number += 1
        stopped(number)
        os.kill(child, signal.SIGCONT)
    return ended(status, said)


def start(command: Command, folder: Path, *, kill_at: int = 0, stopping: bool = False) -> tuple[int, Path]:
    said = Path(tempfile.mkdtemp(prefix="kills-said-"))
    child = os.fork()
    if child == 0:
        code = 70
        try:
            code = _run_here(command, folder, said, kill_at, stopping)
        except SystemExit as leaving:
            code = leaving.code if isinstance(leaving.code, int) else 1
        except BaseException:
            import traceback

            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    return child, said


def finish(child: int, said: Path) -> Ended:
    return ended(os.waitpid(child, 0)[1], said)


def ended(status: int, said: Path) -> Ended:
    """Return how a run ended that is over, and remove what it said."""
    count = said / "count"
    operations = len(count.read_bytes()) if count.exists() else 0
    text = (said / "stderr").read_text(errors="replace") if (said / "stderr").exists() else ""
    shutil.rmtree(said)
    return Ended(os.waitstatus_to_exitcode(status), text, operations)


def _run_here(command: Command, folder: Path, said: Path, kill_at: int, stopping: bool) -> int:
    os.chdir(folder)
    for number, name in ((1, "stdout"), (2, "stderr")):
        os.dup2(os.open(said / name, os.O_WRONLY | os.O_CREAT), number)
    counting = os.open(said / "count", os.O_WRONLY | os.O_CREAT)
    done = 0

    def watch(event: str, given: tuple) -> None:
        nonlocal done
        if event == "open":
            path, _, flags = given
            if not isinstance(flags, int) or not flags & WRITING or not _below(path, folder):
                return
        elif event not in CHANGING or not _below(given[0], folder):
            return
        done += 1
        os.write(counting, b".")
        if stopping or done == kill_at:
            os.kill(os.getpid(), signal.SIGSTOP if stopping else signal.SIGKILL)
            time.sleep(0.002 * stopping)  # a thread may run on for an instant after the signal is sent

    sys.addaudithook(watch)
    return run_words(command.words)


def _below(path: object, folder: Path) -> bool:
    if not isinstance(path, str | bytes | os.PathLike):
        return True  # a descriptor of what was opened here
    text = os.fsdecode(path)
    return not os.path.isabs(text) or text.startswith(str(folder))
