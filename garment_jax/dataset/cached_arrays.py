"""Arrays that a run makes once: read from its cache, or made and stored there."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

from garment_jax.io.formats.limits import LARGEST_ARCHIVE
from garment_jax.io.formats.npz import read_npz
from garment_jax.storage.whole import written_whole

Arrays = Mapping[str, np.ndarray]


def cached_arrays(
    path: Path, make: Callable[[], Arrays], *, fits: Callable[[Arrays], bool] = lambda arrays: True
) -> Arrays:
    """Return the arrays of the cache file `path` (.npz), by name.

    Where the file is not there, is damaged, or holds what does not fit, they are made and stored. Raises
    `OSError` where the disk does not take them.
    """
    with suppress(OSError, ValueError):  # none yet, or damaged: made anew
        stored = read_npz(path, largest=LARGEST_ARCHIVE)
        if fits(stored):
            return stored
    arrays = make()
    with written_whole(path, remedy="free some space or choose another --run-dir") as (made,):
        np.savez(made, **arrays)  # type: ignore[arg-type]
    return arrays


def cached_list(path: Path, make: Callable[[], list[np.ndarray]], lengths: list[int]) -> list[np.ndarray]:
    """Return one array for each of `lengths`, which is how many rows it has; as `cached_arrays`."""

    def fits(arrays: Arrays) -> bool:
        return all(str(i) in arrays and len(arrays[str(i)]) == length for i, length in enumerate(lengths))

    stored = cached_arrays(path, lambda: {str(i): x for i, x in enumerate(make())}, fits=fits)
    return [stored[str(i)] for i in range(len(lengths))]
