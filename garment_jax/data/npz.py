"""Bodies, colliders and pins from `.npz` files of plain arrays."""

import zipfile
from pathlib import Path

import numpy as np

from garment_jax.structs import Collider, Pins, RiggedBody


def load_body(path: Path) -> RiggedBody:
    """Read a rigged body: arrays named as the fields of `RiggedBody`; metres, Y up.

    This and its neighbours raise `FileNotFoundError`, `OSError` for a damaged file, `ValueError` for a
    missing array. Pickled objects are refused like damage.
    """
    body = RiggedBody(*_load_arrays(path, RiggedBody._fields))
    return body._replace(joint_names=tuple(str(name) for name in body.joint_names))


def load_collider(path: Path) -> Collider:
    """Read a collider: arrays named as the fields of `Collider`."""
    return Collider(*_load_arrays(path, Collider._fields))


def load_pin_file(path: Path) -> Pins:
    """Read pins: arrays `pins` `[p]` and `pin_weights` `[p, j]`."""
    return Pins(*_load_arrays(path, ("pins", "pin_weights")))


def _load_arrays(path: Path, keys: tuple[str, ...]) -> list:
    """Return the named arrays of an `.npz` file; pickled objects in it are refused like damage."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {key: file[key] for key in keys if key in file}
    except (zipfile.BadZipFile, EOFError, ValueError, AttributeError, TypeError) as error:
        raise OSError(f"{path} is damaged or no .npz file of plain arrays; copy it again.") from error
    missing = [key for key in keys if key not in arrays]
    if missing:
        raise ValueError(f"{path}: array {missing[0]!r} is missing; it needs {', '.join(keys)}.")
    return [arrays[key] for key in keys]
