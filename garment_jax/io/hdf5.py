"""Reading HDF5 with one clear sentence where h5py raises many kinds of errors."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from garment_jax.io.hdf5_inspection import inspect_hdf5, is_refusal
from garment_jax.storage.missing import not_a_file

# which of them a damaged file raises, and where, depends on the bytes that are gone
_DAMAGE = (OSError, RuntimeError, LookupError, TypeError, ValueError, ArithmeticError, AttributeError)
# endings of what `import` reads
_FOREIGN = frozenset(
    [".bvh", ".npz", ".pkl", ".glb", ".gltf", ".pc2", ".mdd", ".abc", ".usd", ".usda", ".usdc", ".usdz"]
)
_AGAIN = "copy, import or predict it again"


def open_hdf5(path: Path) -> h5py.File:
    """Open any HDF5 file for reading, once it has been inspected as a whole (`inspect_hdf5`).

    FileNotFoundError, OSError (damaged) or ValueError (what it refuses) say in one sentence why not.
    """
    if not path.is_file():
        raise not_a_file(path, "give the path of an HDF5 file (.h5)")
    try:
        inspect_hdf5(path)
        return h5py.File(path, "r")
    except PermissionError as error:
        raise OSError(f"{path} may not be read ({error.strerror}); change its permissions.") from error
    except (*_DAMAGE, MemoryError) as error:
        if is_refusal(error):
            raise
        if path.suffix.lower() in _FOREIGN and "truncated" not in str(error):
            raise OSError(
                f"{path} is no sequence file (.h5); make one of it with garment-jax import."
            ) from error
        reason = "is truncated" if "truncated" in str(error) else "is damaged or no HDF5 file"
        raise OSError(f"{path} {reason}; {_AGAIN}.") from error


def can_open(path: Path) -> bool:
    """Return whether a whole HDF5 file is at `path`, whoever wrote it; one that is refused is whole, too."""
    try:
        open_hdf5(path).close()
    except OSError:
        return False
    except ValueError:
        return True
    return True


def has(file: h5py.File, name: str, where: str) -> bool:
    """Return whether a dataset or group of that name, or a link to one, is there; OSError for damage."""
    with _reading(where):
        return file.get(name) is not None


def dataset(file: h5py.File, name: str, where: str) -> h5py.Dataset:
    """Return a dataset by name; ValueError if it is missing or a group, OSError if `where` is damaged."""
    with _reading(where):
        item = file.get(name)
    if not isinstance(item, h5py.Dataset):
        raise ValueError(f"{where}: dataset `{name}` is missing; export or import the clip again.")
    return item


def dataset_names(file: h5py.File, where: str) -> list[str]:
    """Return the names of all datasets, those in groups as `group/name`; OSError if `where` is damaged."""
    present: list[str] = []
    with _reading(where):
        file.visititems(lambda name, item: present.append(name) if isinstance(item, h5py.Dataset) else None)
    return present


def names_in(file: h5py.File, group: str, where: str) -> tuple[str, ...]:
    """Return the names in a group, none where there is no such group; OSError if `where` is damaged."""
    with _reading(where):
        item = file.get(group)
        return tuple(item) if isinstance(item, h5py.Group) else ()


def attributes_of(item: h5py.Group | h5py.Dataset, where: str) -> dict[str, Any]:
    """Return the attributes as Python's own values (`plain`); OSError if `where` is damaged."""
    with _reading(where):
        return {key: plain(value) for key, value in item.attrs.items()}


def read_all(data: h5py.Dataset, where: str, *, text: bool = False) -> np.ndarray:
    """Return a whole dataset.

    Raises OSError where the file is damaged, ValueError for one that does not fit into memory (or says so)
    and for numbers where `text` is asked.
    """
    name = str(data.name).lstrip("/")
    if data.shape is None:
        raise ValueError(f"{where}: `{name}` is empty; export it again.")
    if text and h5py.check_string_dtype(data.dtype) is None:
        raise ValueError(f"{where}: `{name}` has type {data.dtype}; store text.")
    try:
        with _reading(where):
            return np.asarray(data.asstr(errors="replace")[()], dtype="U") if text else np.asarray(data[()])
    except MemoryError as error:
        raise ValueError(
            f"{where}: `{name}` has shape {data.shape}, more than fits into memory; export it again."
        ) from error


def read_window(data: h5py.Dataset, start: int, stop: int, path: Path) -> np.ndarray:
    """Return rows `start … stop - 1`; ValueError where there are fewer, OSError where the file is damaged."""
    if not data.shape or len(data) < stop:
        name = str(data.name).lstrip("/")
        raise ValueError(f"{path}: `{name}` has shape {data.shape}, without frame {stop - 1}; write it anew.")
    try:
        return data[start:stop]
    except _DAMAGE as error:
        raise OSError(
            f"{path}: frames {start} … {stop - 1} cannot be read, the file is damaged; {_AGAIN}."
        ) from error


def plain(value: object) -> Any:
    """Return an HDF5 attribute as Python's own int, float, bool or str, an array as a list of them.

    What is none of these (empty, a reference, a complex number) becomes a string.
    """
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, np.ndarray):
        return [plain(entry) for entry in value.tolist()]
    value = value.item() if isinstance(value, np.generic) and not isinstance(value, np.void) else value
    return value if isinstance(value, int | float | str | list | None) else str(value)


@contextmanager
def _reading(where: str) -> Iterator[None]:
    try:
        yield
    except _DAMAGE as error:
        raise OSError(f"{where} is damaged or truncated; {_AGAIN}.") from error
