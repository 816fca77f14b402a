"""Folders of one process' own, in which files are built beside the place where they will appear.

Their names cannot be guessed, nobody else may look into them, and they are made, never taken over: a link
planted in the way is not followed. What a process that was killed left is removed by the next one that writes
there.
"""

import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from garment_jax.storage.processes import Process, is_dead, this_process

_NAME = re.compile(r"\.(\d+)-(\d+)-([A-Za-z0-9._]+)-[0-9a-f]{16}\.partial")


@contextmanager
def scratch(folder: Path) -> Iterator[Path]:
    """Give a new folder inside `folder`, which is removed at the end with what is still in it."""
    made = make_scratch(folder)
    try:
        yield made
    finally:
        remove_scratch(made)


@contextmanager
def unmade(folder: Path) -> Iterator[None]:
    """If what follows raises, remove `folder` and those above it that were not there before, where empty."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        yield
    except BaseException:
        with suppress(OSError):  # one that holds something, or was never made
            for path in missing:
                path.rmdir()
        raise


def make_scratch(folder: Path) -> Path:
    """Make a folder for this process' unfinished files inside `folder`, and sweep there first.

    `folder` is made where it is missing. Whoever asks for it removes it with `remove_scratch`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    sweep(folder)
    pid, started, host = this_process()
    made = folder / f".{pid}-{started}-{host}-{secrets.token_hex(8)}.partial"
    made.mkdir(mode=0o700)
    return made


def remove_scratch(made: Path) -> None:
    """Remove a folder that `make_scratch` made."""
    shutil.rmtree(made, ignore_errors=True)


def sweep(folder: Path) -> None:
    """Remove the scratch folders of processes of this machine that have ended, and of no others."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            owner = _owner(entry.name)
            if owner is not None and is_dead(owner) and entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path, ignore_errors=True)


def _owner(name: str) -> Process | None:
    """Return whose scratch folder has this name; None where it is no such name."""
    found = _NAME.fullmatch(name)
    return None if found is None else Process(int(found[1]), int(found[2]), found[3])
