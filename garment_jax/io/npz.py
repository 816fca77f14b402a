"""Bodies, colliders and pins from `.npz` files of plain arrays, checked one by one."""

from pathlib import Path
from typing import Any

import numpy as np

from garment_jax.io.formats.npz import read_npz
from garment_jax.io.layout import BODY, COLLIDER, PINS, Field, Known, check_fields, check_parents
from garment_jax.structs import Collider, Pins, RiggedBody


def _named(fields: tuple[Field, ...], names: tuple[str, ...]) -> tuple[Field, ...]:
    """Return the sequence file's fields under the names that they have in files of their own."""
    return tuple(field._replace(name=name) for field, name in zip(fields, names, strict=True))


_BODY = _named(BODY, RiggedBody._fields)
_COLLIDER = _named(COLLIDER, Collider._fields)
_PINS = _named(PINS, ("pins", "pin_weights"))


def load_body(path: Path) -> RiggedBody:
    """Read a rigged body: arrays named as the fields of `RiggedBody`; metres, Y up.

    This and its neighbours raise `FileNotFoundError`, `OSError` for a damaged file, and `ValueError` with
    file and array for what is missing or does not fit: types, shapes, indices, values that are not
    finite, weights that do not sum to 1, pickled objects. Lengths are not looked at.
    """
    body = RiggedBody(*_load(path, _BODY))
    check_parents(body.parents, str(path), "parents")
    return body._replace(joint_names=tuple(str(name) for name in body.joint_names))


def load_collider(path: Path, known: Known | None = None) -> Collider:
    """Read a collider: arrays named as the fields of `Collider`; `known` as in `check_fields`."""
    return Collider(*_load(path, _COLLIDER, known))


def load_pin_file(path: Path, known: Known | None = None) -> Pins:
    """Read pins: arrays `pins` `[p]` and `pin_weights` `[p, j]`; `known` as in `check_fields`."""
    return Pins(*_load(path, _PINS, known))


def read_arrays(path: Path, keys: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Return those of the named arrays that an `.npz` file holds.

    Raises `FileNotFoundError`, `OSError` for a damaged file, `ValueError` for pickled objects: reading
    them would run whatever they say, and for archives and shapes that would fill the memory (`read_npz`).
    """
    return read_npz(path, keys)


def _load(path: Path, fields: tuple[Field, ...], known: Known | None = None) -> list[Any]:
    """Return the arrays of `fields` in their order and in the types of the structures."""
    arrays = read_arrays(path, tuple(field.name for field in fields))
    missing = [field.name for field in fields if field.name not in arrays]
    if missing:
        needed = ", ".join(field.name for field in fields)
        raise ValueError(f"{path}: array {missing[0]!r} is missing; it needs {needed}.")
    check_fields(fields, arrays, str(path), known)
    return [arrays[field.name].astype(field.dtype) for field in fields]
