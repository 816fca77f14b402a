"""Predictions and truths that belong together."""

from pathlib import Path


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
