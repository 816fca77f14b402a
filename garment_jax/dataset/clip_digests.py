"""Hashes of clips' bytes, remembered by size and time of change, so that each is read once.

A copy of a clip is the same clip: what is named by its hash is found again after a move, a download or
an import anew.
"""

import hashlib
import json
from pathlib import Path

from garment_jax.storage.whole import write_text

NAME = "clips.json"


class ClipDigests:
    """Hashes of the clips that a folder of caches was made from; forgotten where a file has changed."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / NAME
        try:
            known = json.loads(self._path.read_text(encoding="utf-8"))
        except (OSError, ValueError):  # none yet, or damaged: they are read anew
            known = {}
        self._known: dict[str, list] = known if isinstance(known, dict) else {}

    def of(self, path: Path) -> str:
        """Return the SHA-256 of a file's bytes, in hexadecimal digits."""
        stat, name = path.stat(), str(path.resolve())
        stamp = [stat.st_size, stat.st_mtime_ns]
        found = self._known.get(name)
        if isinstance(found, list) and found[:2] == stamp and len(found) == 3:
            return str(found[2])
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        self._known[name] = [*stamp, digest]
        self._save()
        return digest

    def _save(self) -> None:
        write_text(self._path, json.dumps(self._known, indent=1) + "\n")
