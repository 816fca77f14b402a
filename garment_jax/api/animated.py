"""Which animations of a folder are there already, made of the same model and motion: a command goes on.

A record beside each says what it was made of and, when it is whole, its files. It is written before them, so
that a job that was stopped in between may replace what it has left, and no other.
"""

import hashlib
import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from garment_jax.api.opened import Wanted
from garment_jax.api.outputs import Output
from garment_jax.api.written_as import Shape
from garment_jax.storage.whole import write_text

if TYPE_CHECKING:
    from garment_jax.importers.sources import Options

RECORDS = ".animated"  # inside the folder of the outputs


def made_of(model: Path, output: Output, shape: Shape, own: "Options", asked: Wanted) -> str:
    """Return 16 hexadecimal digits of all that an output is made of; of files by name, size and time."""
    motion = [] if output.motion is None else [output.motion]
    files = [_stat(path) for path in [*sorted(model.rglob("*")), *motion] if path.is_file()]
    parts = [files, output.format, list(shape), str(own), list(asked)]
    return hashlib.sha256(json.dumps(parts, default=str).encode()).hexdigest()[:16]


def is_made(output: Output, key: str) -> bool:
    """Return whether an output of that content is there, whole."""
    files = _read(output, key).get("files", [])
    return bool(files) and all((output.path.parent / name).exists() for name in files)


def is_begun(output: Output, key: str) -> bool:
    """Return whether a job of that content was begun, whose files may be replaced."""
    return _read(output, key).get("files") == []


def record(output: Output, key: str, files: Sequence[Path] = ()) -> None:
    """Write that an output was begun, or that its `files` are whole."""
    path = _path(output)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps({"made_of": key, "files": [file.name for file in files]}) + "\n")


def forget(output: Output) -> None:
    """Remove the record of a job that failed, and the folder where it was the last."""
    path = _path(output)
    path.unlink(missing_ok=True)
    with suppress(OSError):
        path.parent.rmdir()


def _path(output: Output) -> Path:
    return output.path.parent / RECORDS / f"{output.path.name}.json"


def _read(output: Output, key: str) -> dict[str, Any]:
    try:
        known = json.loads(_path(output).read_text(encoding="utf-8"))
        return known if known["made_of"] == key else {}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _stat(path: Path) -> tuple[str, int, int]:
    found = path.stat()
    return str(path.resolve()), found.st_size, found.st_mtime_ns
