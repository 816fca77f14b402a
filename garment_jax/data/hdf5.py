"""Reading HDF5 with one clear sentence where h5py raises many kinds of errors."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np


def open_hdf5(path: Path) -> h5py.File:
    """Open any HDF5 file for reading; FileNotFoundError or OSError say in one sentence why not."""
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file; give the path of an HDF5 file (.h5).")
    try:
        return h5py.File(path, "r")
    except OSError as error:
        reason = "is truncated" if "truncated" in str(error) else "is damaged or no HDF5 file"
        raise OSError(f"{path} {reason}; copy, import or predict it again.") from error


def dataset(file: h5py.File, name: str, where: str) -> h5py.Dataset:
    """Return a dataset by name, or raise ValueError if it is missing or a group."""
    item = file.get(name)
    if not isinstance(item, h5py.Dataset):
        raise ValueError(f"{where}: dataset `{name}` is missing; export or import the clip again.")
    return item


def read_window(data: h5py.Dataset, start: int, stop: int, path: Path) -> np.ndarray:
    """Return rows `start … stop - 1`; OSError where the file is damaged."""
    try:
        return data[start:stop]
    except OSError as error:
        raise OSError(
            f"{path}: frames {start} … {stop - 1} cannot be read, the file is damaged; copy, import or "
            "predict it again."
        ) from error


def plain(value: object) -> Any:
    """Return an HDF5 attribute as Python's own int, float, bool or str, an array as a list of them."""
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, np.ndarray):
        return [plain(entry) for entry in value.tolist()]
    return value.item() if isinstance(value, np.generic) else value
