"""Numbers of foreign files as arrays of ours: whatever type, order or container their writer chose."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

_DEEPEST = 4  # lists within lists: frames, joints or vertices, coordinates
_MOST = 2**24  # numbers of nested lists; a list may stand in another many times


def number_array(value: Any, name: str, path: Path) -> np.ndarray:
    """Return an array, a number or nested lists of numbers as an array of a plain type, writable.

    Floats of any width and byte order become float64 or stay float32, whole numbers int64; the order in
    memory is C's. Raises `ValueError`, by name, for anything that is no number: text, truth values, dates,
    complex numbers, structures, objects, lists of unequal lengths.
    """
    try:
        return _plain(value)
    except (TypeError, ValueError, OverflowError):
        kind = value.dtype if isinstance(value, np.ndarray) else type(value).__name__
        raise ValueError(
            f"{path}: {name!r} is of type {str(kind)[:60]}, not an array of numbers; save it as one."
        ) from None


def is_index(numbers: np.ndarray, count: int) -> bool:
    """Return whether all numbers are whole and lie in 0 … `count` - 1, in whatever type they came."""
    if numbers.dtype.kind == "f" and not (numbers == np.floor(numbers)).all():
        return False
    return bool(not numbers.size or (numbers.min() >= 0 and numbers.max() < count))


def _plain(value: Any) -> np.ndarray:
    if isinstance(value, list | tuple):
        return _of_lists(value, _DEEPEST, [_MOST])
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = np.asarray(float(value))
    if not isinstance(value, np.ndarray | np.generic):
        raise TypeError
    value = np.asarray(value)
    if value.dtype.kind == "O":
        return _of_lists(value.tolist(), _DEEPEST, [_MOST]) if value.ndim else _plain(value.item())
    if value.dtype.kind not in "fiu":
        raise TypeError
    kind = np.int64 if value.dtype.kind in "iu" else np.float32 if value.dtype.itemsize == 4 else np.float64
    with np.errstate(over="ignore"):  # what float64 cannot hold becomes infinite, and is refused as such
        plain = np.require(value, kind, ["C", "W"])
    if value.dtype.kind == "u" and plain.size and plain.min() < 0:
        raise OverflowError
    return plain


def _of_lists(items: Sequence[Any], deepest: int, left: list[int]) -> np.ndarray:
    """Return nested lists as an array; `left` counts down the numbers that may still come."""
    left[0] -= len(items)
    if left[0] < 0 or not deepest:
        raise ValueError
    if all(type(item) in (int, float) for item in items):
        return np.array(items, np.float64)
    rows = []
    for item in items:
        row = _of_lists(item, deepest - 1, left) if isinstance(item, list | tuple) else _plain(item)
        left[0] -= row.size
        if left[0] < 0:
            raise ValueError
        rows.append(row)
    return np.stack(rows)
