"""The net under all readers: damage that none of them foresaw still ends in one sentence on its file."""

import functools
import json
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

P = ParamSpec("P")
R = TypeVar("R")

# what a reader's own code or a library raises where bytes are not what they should be; `tests/fuzz` counts
# how often each comes this far, for a reader should say better what is wrong
_UNFORESEEN = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    LookupError,
    NotImplementedError,
    RuntimeError,  # RecursionError, too
    TypeError,
    UnicodeError,
    json.JSONDecodeError,
    np.linalg.LinAlgError,
    struct.error,
    zlib.error,
)


@contextmanager
def reading(path: str | Path) -> Iterator[None]:
    """Turn what reading a foreign file raises by surprise into a sentence with its name.

    `ValueError` for what does not fit into memory, `OSError` for the rest; sentences pass as they are.
    """
    try:
        yield
    except MemoryError as error:
        raise ValueError(f"{path} does not fit into memory; cut it into clips.") from error
    except _UNFORESEEN as error:
        said = " ".join(str(error).split())[:200]
        raise OSError(
            f"{path} is damaged: {type(error).__name__} {said}; copy or export it again."
        ) from error


def reads_foreign(read: Callable[P, R]) -> Callable[P, R]:
    """Put a reader, whose first argument is the path, above the net of `reading`."""

    @functools.wraps(read)
    def guarded(*args: Any, **options: Any) -> Any:
        with reading(args[0] if args else next(iter(options.values()))):
            return read(*args, **options)

    return guarded
