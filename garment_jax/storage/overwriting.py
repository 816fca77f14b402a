"""Nothing that is there is replaced without `--force`."""

import os
import re
from pathlib import Path

from garment_jax.storage.scratch import sweep

_OBJ_FRAME = re.compile(r"(garment|body)_\d+\.obj")


def check_free(path: Path, force: bool, *, frames: bool = False) -> None:
    """Raise `ValueError` where `path` is there and may not be replaced.

    Of folders only those of `frames` may be; others are left to the writer to refuse. A run that was killed
    once its files were whole is refused so, too: what it left besides is removed here.
    """
    if not os.path.lexists(path):
        return
    if path.is_dir():
        if not frames:
            return
        files = [file for file in path.rglob("*") if not file.is_dir()]
        if any(not _OBJ_FRAME.fullmatch(file.name) for file in files):
            raise ValueError(f"{path} is a folder that holds other files; name another --out.")
        if not files:
            return
    if not force:
        sweep(path.parent)
        raise ValueError(f"{path} is there already; --force replaces it, or name another --out.")
