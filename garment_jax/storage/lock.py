"""A folder that one process at a time works in: the second one is refused, and told who is there.

The system's own lock on a file decides, so that a process which was killed holds nothing. The file says who
it is; it stays after a kill and is taken over. Where a file system knows no locks (some that machines share),
what the file says decides.
"""

import errno
import hashlib
import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from garment_jax.storage.processes import Process, is_dead, this_process

NAME = ".lock"
_NO_LOCKS = (errno.EOPNOTSUPP, errno.ENOTSUP, errno.ENOLCK, errno.ENOSYS, errno.EINVAL)
_TRIES = 100  # of making a folder and its lock while others remove theirs


def lock_name(clip: str) -> str:
    """Return the lock's name where only one clip of a folder is held, of whatever name."""
    return f"{NAME}-{hashlib.sha256(clip.encode('utf-8', 'surrogateescape')).hexdigest()[:16]}"


@contextmanager
def locked(
    folder: Path, doing: str, *, name: str = NAME, remedy: str = "choose another folder"
) -> Iterator[None]:
    """Hold `folder`, which is made where it is missing, until the block ends.

    Raises `OSError` in one sentence where another process holds it: who, since when, `doing` what, and what
    to do. A folder that was made here and is still empty at the end is removed again.
    """
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    path = folder / name
    try:
        descriptor = _taken(path, remedy)
        try:
            _sign(descriptor, doing)
            yield
        finally:
            path.unlink(missing_ok=True)
            os.close(descriptor)
    finally:
        with suppress(OSError):  # it holds something now, or another process' lock
            for made in new:
                made.rmdir()


def _taken(path: Path, remedy: str) -> int:
    """Return the descriptor of the lock file, which is ours now."""
    for _ in range(_TRIES):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
        except FileNotFoundError:  # the process that had made the folder removed it again
            continue
        except OSError as error:
            raise OSError(f"{path.parent} cannot be worked in ({error.strerror}); {remedy}.") from error
        try:
            _take(descriptor, path, remedy)
            if _is_there(descriptor, path):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # of a process that has just ended, and removed it
        time.sleep(0.01)
    raise OSError(f"{path.parent} is made and removed by other processes; {remedy}.")


def _take(descriptor: int, path: Path, remedy: str) -> None:
    try:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise OSError(f"{_holder(_signature(descriptor), path)}; wait until it ends, or {remedy}.") from error
    except (ImportError, OSError) as error:
        if isinstance(error, OSError) and error.errno not in _NO_LOCKS:
            raise
        facts = _signature(descriptor)
        if facts and not is_dead(_process(facts)) and _process(facts) != this_process():
            raise OSError(
                f"{_holder(facts, path)}; wait until it ends (or delete {path} if it has), or {remedy}."
            ) from error


def _is_there(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path, follow_symlinks=False))
    except FileNotFoundError:
        return False


def _sign(descriptor: int, doing: str) -> None:
    facts = {**this_process()._asdict(), "doing": doing, "since": time.strftime("%Y-%m-%d %H:%M")}
    os.ftruncate(descriptor, 0)
    os.pwrite(descriptor, json.dumps(facts).encode(), 0)


def _signature(descriptor: int) -> dict[str, Any]:
    """Return what the file says of its holder; empty where it says nothing yet."""
    try:
        facts = json.loads(os.pread(descriptor, 4096, 0))
        return facts if {*Process._fields, "doing", "since"} <= facts.keys() else {}
    except (ValueError, AttributeError, OSError):
        return {}


def _process(facts: dict[str, Any]) -> Process:
    return Process(*(facts[name] for name in Process._fields))


def _holder(facts: dict[str, Any], path: Path) -> str:
    if not facts:
        return f"another process works in {path.parent}"
    machine = str(facts["host"]).rpartition("_")[0] or facts["host"]
    return f"process {facts['pid']} on {machine} is {facts['doing']} in {path.parent} since {facts['since']}"
