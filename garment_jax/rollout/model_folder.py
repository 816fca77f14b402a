"""The folder that a model is saved into: what may be replaced there, and how, so that no mixture loads."""

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

FACTS = "model.json"  # goes first and comes last: without it a folder holds no model
MEASURED = ("figures.json", "variants.json")  # of the parameters that lie beside them
_REPLACED = f"{FACTS}.replaced"  # the old facts while the other files change
_HIDDEN = ".saving."  # beginning of the folder that files are written in


def check_replaceable(folder: Path, garment_hash: str) -> None:
    """Check that a model of the garment may be saved into `folder`: a new or empty one, or its own model's.

    Raises `ValueError` for a file, a run, a folder of other things and a model of another garment.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"--out {folder} is a file; a model fills a folder, name a new one.")
    if not folder.is_dir():
        return
    if (folder / "checkpoints").is_dir():
        raise ValueError(f"--out {folder} is a run, whose files a model would replace; name another folder.")
    facts = next((folder / name for name in (FACTS, _REPLACED) if (folder / name).is_file()), None)
    if facts is None:
        others = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
        if others:
            raise ValueError(
                f"--out {folder} holds {others[0]!r} but no model; name another folder, new or empty."
            )
        return
    there = _garment_of(facts)
    if there != garment_hash:
        raise ValueError(
            f"--out {folder} holds a model of another garment (hash {there}, not {garment_hash}); "
            "name another folder."
        )


def _garment_of(facts: Path) -> str:
    try:
        return json.loads(facts.read_text(encoding="utf-8"))["garment_hash"]
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(
            f"--out {facts.parent} holds a damaged model ({facts.name}: {error}); name another folder."
        ) from error


@contextmanager
def written_together(folder: Path) -> Iterator[Path]:
    """Give a hidden folder to write the files in; at the end they take the place of those of `folder`.

    Killed before the end, it leaves the old model, or between two renames a folder that does not load and
    may be saved into again. What was measured with the old parameters goes with them.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _sweep(folder)
    partial = folder / f"{_HIDDEN}{os.getpid()}"  # inside: `folder` may be a disk of its own
    try:
        partial.mkdir()
        yield partial
        _move(partial, folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _move(partial: Path, folder: Path) -> None:
    if (folder / FACTS).exists():
        os.replace(folder / FACTS, folder / _REPLACED)
    for name in MEASURED:
        (folder / name).unlink(missing_ok=True)
    for path in sorted(partial.iterdir(), key=lambda path: path.name == FACTS):
        os.replace(path, folder / path.name)
    (folder / _REPLACED).unlink(missing_ok=True)


def _sweep(folder: Path) -> None:
    """Remove what killed calls left."""
    for leftover in folder.glob(f"{_HIDDEN}*"):
        shutil.rmtree(leftover, ignore_errors=True)
