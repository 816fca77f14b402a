"""Output that appears when it is whole: written under temporary names, moved into place at the end."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def written_whole(*targets: Path) -> Iterator[tuple[Path, ...]]:
    """Yield a temporary name for each of `targets` (files or folders, the suffix is kept).

    When the block ends well, what was written there takes the targets' names; older files are replaced. On
    any error, Ctrl-C too, it is deleted. Raises `OSError` in one sentence where the disk does not take it,
    and before anything is made where a target is a folder that holds something.
    """
    for target in targets:
        if target.is_dir() and any(target.iterdir()):
            raise OSError(f"{target} is a folder that is not empty; name a new one.")
    temporary = tuple(t.with_name(f".{t.stem}.{os.getpid()}.tmp{t.suffix}") for t in targets)
    try:
        targets[0].parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        for made, target in zip(temporary, targets, strict=True):
            if target.is_dir():
                target.rmdir()
            os.replace(made, target)
    except OSError as error:
        if error.strerror is None:  # a sentence already
            raise
        raise OSError(
            f"{targets[0]} could not be written ({error.strerror}); nothing was saved, free some space or "
            "choose another folder."
        ) from error
    finally:
        for made in temporary:
            if made.is_dir():
                shutil.rmtree(made, ignore_errors=True)
            made.unlink(missing_ok=True)
