"""The one way to write files: built in a scratch folder, moved into place when they are whole."""

import errno
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from garment_jax.storage.scratch import make_scratch, remove_scratch, scratch

_FILLED = (errno.ENOTEMPTY, errno.EEXIST)


@contextmanager
def written_whole(
    *targets: Path,
    last: Sequence[Path] = (),
    gone: Sequence[Path] = (),
    folders: bool = False,
    remedy: str = "nothing was saved, free some space or choose another folder",
) -> Iterator[tuple[Path, ...]]:
    """Yield a path to write for each of `targets`: files or folders of one folder, under their own names.

    When the block ends well, what was written there takes the targets' places, as `replaced` says. Raises
    `OSError` in one sentence with `remedy` where the disk does not take it, and before anything is made where
    a target is a folder that holds something; with `folders` that is replaced.
    """
    for target in targets:
        if not folders and target.is_dir() and any(target.iterdir()):
            raise OSError(f"{target} is a folder that is not empty; name a new one.")
    try:
        with replaced(*targets, last=last, gone=gone, folders=folders) as made:
            yield made
    except OSError as error:
        if error.strerror is None:  # a sentence already
            raise
        if error.errno in _FILLED:
            raise OSError(f"{targets[0]} was filled by another process meanwhile; name a new one.") from error
        raise OSError(f"{targets[0]} could not be written ({error.strerror}); {remedy}.") from error


@contextmanager
def replaced(
    *targets: Path, last: Sequence[Path] = (), gone: Sequence[Path] = (), folders: bool = False
) -> Iterator[tuple[Path, ...]]:
    """Yield a path to write for each of `targets`, and move what is there into place at the end.

    On any error, Ctrl-C too, nothing is left and older files stay. Files that belong together are moved in
    an order that leaves no mixture when the process is killed between them: those of `last`, without which
    the set is not read, and those of `gone`, which the new set lacks, are removed before the others change;
    `last` come last. One process at a time moves such a set into a folder.
    """
    folder = targets[0].parent
    with scratch(folder) as place:
        made = tuple(place / target.name for target in targets)
        yield made
        for path in made:
            sync(path)
        if len(targets) == 1 and not gone:
            if folders and targets[0].is_dir():
                os.rename(
                    targets[0], place / ".replaced"
                )  # no folder takes the place of one that holds something
            os.replace(made[0], targets[0])
            return
        with _alone(folder):
            for path in (*last, *gone):
                path.unlink(missing_ok=True)
            for path, target in sorted(zip(made, targets, strict=True), key=lambda pair: pair[1] in last):
                os.replace(path, target)


class Unfinished:
    """A file that is written piece by piece at `path`, in a scratch folder, until `move` or `discard`."""

    def __init__(self, target: Path) -> None:
        self._target = target
        self._place = make_scratch(target.parent)
        self.path = self._place / target.name

    def move(self) -> None:
        """Let the file, closed by now, take the target's place."""
        sync(self.path)
        os.replace(self.path, self._target)

    def discard(self) -> None:
        """Remove what has not been moved."""
        remove_scratch(self._place)


def write_text(path: Path, text: str) -> None:
    """Write a text file, UTF-8, whole or not at all."""
    with replaced(path) as (made,):
        made.write_text(text, encoding="utf-8")


def link_or_copy(source: str | Path, target: str | Path) -> None:
    """Make `target` the file `source` by another name, or a copy where the file system has no such links."""
    try:
        os.link(source, target)
    except FileExistsError:
        raise
    except OSError:
        shutil.copy2(source, target)


def sync(path: Path) -> None:
    """Force a file, or a folder's list of names, to the disk; so a power cut leaves no empty one."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Wait until no other process is here with this `folder`, where the file system knows locks."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
