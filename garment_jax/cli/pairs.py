"""Predictions and truths that belong together, and what becomes of the others where one cannot be read."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class LeftOut:
    """The files of a command that could not be read, while the others went on."""

    def __init__(self, count: int) -> None:
        self.count = count  # of all files
        self.names: list[str] = []

    @contextmanager
    def reading(self, path: Path) -> Iterator[None]:
        """Print what is wrong with a file and go on; an only one raises it."""
        from garment_jax.io.formats.damage import reading

        try:
            with reading(path):
                yield
        except (ValueError, OSError) as error:
            if self.count == 1:
                raise
            self.note(path, str(error))

    def note(self, path: Path, error: str) -> None:
        """Print what is wrong with a file; of an only one raise it."""
        if self.count == 1:
            raise ValueError(error)
        print(f"left out: {error}", file=sys.stderr, flush=True)
        self.names.append(path.name)

    def check(self) -> None:
        """Raise `ValueError` where any was left out, once the others are done."""
        if self.names:
            raise ValueError(f"left out: {', '.join(self.names)}; the reasons are above.")


def pair_files(pred: Path, truth: Path) -> list[tuple[Path, Path]]:
    """Pair two files, or every prediction in a folder with the truth of the same name."""
    if pred.is_dir() != truth.is_dir():
        raise ValueError(f"{pred} and {truth} are a file and a folder; give two files or two folders.")
    if not pred.is_dir():
        return [(pred, truth)]
    pairs = [(path, truth / path.name) for path in sorted(pred.glob("*.h5"))]
    if not pairs:
        raise FileNotFoundError(f"{pred} holds no predictions (*.h5); run infer.py into it first.")
    return pairs
