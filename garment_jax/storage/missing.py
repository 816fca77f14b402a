"""What is said of a file that cannot be opened because it is not there, or is a folder."""

from pathlib import Path


def not_a_file(path: Path, remedy: str) -> FileNotFoundError:
    """Return the refusal of a path that is no file; `remedy` says what to name."""
    return FileNotFoundError(f"{path} is {'a folder' if path.is_dir() else 'not there'}; {remedy}.")
