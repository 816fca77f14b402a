"""The last line of a command: what to do next. On standard error, so that results can be piped."""

import shlex
import sys
from pathlib import Path


def say_next(*words: str | Path, why: str = "") -> None:
    """Print a command of this package as a shell takes it, with `why` as its comment."""
    typed = [
        f"./{word}" if isinstance(word, Path) and str(word).startswith("-") else str(word) for word in words
    ]
    say_step(f"{shlex.join(['garment-jax', *typed])}{why and f'  # {why}'}")


def say_step(text: str) -> None:
    """Print what to do next where that is no command of this package."""
    print(f"next: {text}", file=sys.stderr, flush=True)
