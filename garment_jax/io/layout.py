"""The layout of a sequence file: every dataset's name, type and shape, and the checks on them.

`docs/formats.md` is the same table for readers outside Python. A letter stands for a size that must be
the same wherever it appears: t frames, n garment vertices, f garment faces, u texture vertices, b body
vertices, g body faces, j joints, c body vertices of the collider, d collider faces, k cap vertices, e
collider vertices (c, and one more for a cap), p pins.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from garment_jax.body.frame_windows import FrameWindows, stretches
from garment_jax.structs import Collider, Garment, Motion, Pins, RiggedBody, Scene

SCHEMA_VERSION = 1


class Field(NamedTuple):
    """One dataset of the file."""

    name: str
    dtype: str  # NumPy's letter; "U" is text
    shape: tuple[str | int, ...]
    below: str = ""  # letter of the size that bounds an index
    sums_to_1: bool = False  # each row: weights


GARMENT = (
    Field("template", "f4", ("n", 3)),
    Field("faces", "i4", ("f", 3), "n"),
    Field("uv", "f4", ("u", 2)),
    Field("faces_uv", "i4", ("f", 3), "u"),
)
BODY = (
    Field("body/vertices", "f4", ("b", 3)),
    Field("body/faces", "i4", ("g", 3), "b"),
    Field("body/joints", "f4", ("j", 3)),
    Field("body/parents", "i4", ("j",)),
    Field("body/joint_names", "U", ("j",)),
    Field("body/skin_weights", "f4", ("b", "j"), sums_to_1=True),
)
COLLIDER = (
    Field("collider/body_vertices", "i4", ("c",), "b"),
    Field("collider/cap_loop", "i4", ("k",), "b"),
    Field("collider/faces", "i4", ("d", 3), "e"),
)
PINS = (
    Field("pins/vertices", "i4", ("p",), "n"),
    Field("pins/weights", "f4", ("p", "j"), sums_to_1=True),
)
MOTION = (
    Field("rotations", "f4", ("t", "j", 3, 3)),
    Field("root", "f8", ("t", 3)),
)
REQUIRED = GARMENT + BODY + MOTION
# NumPy's letters of types that serve as a field's own, and what they are
_SERVES = {"f": ("fiu", "numbers"), "i": ("iu", "whole numbers"), "U": ("U", "text")}
Known = Mapping[str, tuple[int, str]]  # letter -> its size in another file, and that file's name


def fields_of(present: Iterable[str]) -> tuple[Field, ...]:
    """Return the fields that a file with these dataset names must have: a group is whole or absent."""
    groups = {name.split("/")[0] for name in present}
    fields = REQUIRED
    fields += COLLIDER if "collider" in groups else ()
    return fields + (PINS if "pins" in groups else ())


def to_arrays(scene: Scene, motion: Motion, where: str) -> dict[str, Any]:
    """Return the file's datasets, without the vertices, by name and in the file's types (see `cast`).

    Rotations that are read in stretches stay so.
    """
    structs = {"": scene.garment, "body/": scene.body, "collider/": scene.collider, "pins/": scene.pins}
    arrays = {
        prefix + key: np.asarray(value)
        for prefix, struct in structs.items()
        if struct is not None
        for key, value in struct._asdict().items()
    }
    arrays |= {"rotations": motion.rotations, "root": np.asarray(motion.root)}
    if not isinstance(motion.rotations, FrameWindows):
        arrays["rotations"] = np.asarray(motion.rotations)
    return {
        field.name: array if isinstance(array, FrameWindows) else cast(field, array, where)
        for field in fields_of(arrays)
        for array in (arrays[field.name],)
    }


def cast(field: Field, array: np.ndarray, where: str) -> np.ndarray:
    """Return the array in the field's type, with as many axes as the field has.

    Raises ValueError (naming `where`) for another number of axes, for what is no number, and for an index
    with a fraction, or one that 32 bits do not hold: both would become another index.
    """
    check_kind(field, array.shape, array.dtype, where)
    if field.dtype == "i4" and array.dtype != np.int32 and array.size:
        limits = np.iinfo(np.int32)
        wide = array.astype(np.float64) if array.dtype.kind == "f" else array  # whose own digits may not do
        wrong = (wide != np.rint(wide)) | ~((wide >= limits.min) & (wide <= limits.max))
        if wrong.any():
            value = array[wrong][0]
            raise ValueError(f"{where}: `{field.name}` holds {value}; store whole numbers of 32 bits.")
    return array.astype(field.dtype, copy=False)


def check_kind(field: Field, shape: tuple[int, ...], dtype: np.dtype, where: str) -> None:
    """Raise ValueError for an array that is no number, or no text, or has another number of axes."""
    if 0 not in shape and dtype.kind not in ("U" if field.dtype == "U" else "fiu"):
        found = "text" if dtype.kind in "SUO" else dtype
        kind = "text" if field.dtype == "U" else "numbers"
        raise ValueError(f"{where}: `{field.name}` has type {found}; store {kind}.")
    if len(shape) != len(field.shape):
        raise ValueError(f"{where}: `{field.name}` has shape {shape}, expected {_spell(field.shape)}.")


def to_scene(arrays: Mapping[str, Any]) -> Scene:
    """Return the scene held by a file's datasets; the inverse of `to_arrays`."""

    def group(fields: tuple[Field, ...]) -> list:
        return [arrays[field.name] for field in fields]

    body = RiggedBody(*group(BODY))
    body = body._replace(joint_names=tuple(str(name) for name in body.joint_names))
    collider = Collider(*group(COLLIDER)) if "collider/faces" in arrays else None
    pins = Pins(*group(PINS)) if "pins/vertices" in arrays else None
    return Scene(Garment(*group(GARMENT)), body, collider, pins)


def check_arrays(arrays: Mapping[str, Any], where: str) -> dict[str, int]:
    """Return the sizes by letter, or raise ValueError (naming `where`) if the datasets do not agree."""
    _check_present(arrays, where)
    sizes = check_fields(fields_of(arrays), arrays, where)
    check_parents(arrays["body/parents"], where, "body/parents")
    check_uv(arrays["uv"], where)
    return sizes


def check_fields(
    fields: Iterable[Field], arrays: Mapping[str, Any], where: str, known: Known | None = None
) -> dict[str, int]:
    """Return the sizes by letter, or raise ValueError (naming `where`) for an array that does not fit.

    Types, shapes, indices, finite values, weights that sum to 1. `known` are the sizes that other files
    of the scene have set; an index into what neither they nor these arrays size is not checked.
    """
    fields = tuple(fields)
    sizes = {letter: size for letter, (size, _) in (known or {}).items()}
    origin = {letter: name for letter, (_, name) in (known or {}).items()}
    for field in fields:
        _check_type(field, arrays[field.name], where)
        bind_shape(field, arrays[field.name].shape, sizes, origin, where)
    _check_not_empty(sizes, where)
    if "c" in sizes:
        sizes["e"] = sizes["c"] + min(sizes["k"], 1)
    for field in fields:
        if field.below in sizes:
            mesh = known[field.below][1] if known and field.below in known else "the mesh in the same file"
            _check_range(field.name, arrays[field.name], sizes[field.below], mesh, where)
        if field.dtype.startswith("f"):
            _check_finite(field.name, arrays[field.name], where)
        if field.sums_to_1:
            _check_weights(field.name, arrays[field.name], where)
    return sizes


def bind_shape(
    field: Field, shape: tuple[int, ...], sizes: dict[str, int], origin: dict[str, str], where: str
) -> None:
    """Check `shape` against the field's and record the letters' sizes seen for the first time."""
    if len(shape) != len(field.shape):
        raise ValueError(f"{where}: `{field.name}` has shape {shape}, expected {_spell(field.shape)}.")
    for expected, size in zip(field.shape, shape, strict=True):
        if isinstance(expected, int) and size != expected:
            raise ValueError(f"{where}: `{field.name}` has shape {shape}, expected {_spell(field.shape)}.")
        if isinstance(expected, str) and sizes.setdefault(expected, size) != size:
            raise ValueError(
                f"{where}: `{field.name}` has shape {shape}, but `{origin[expected]}` says "
                f"{expected} = {sizes[expected]}; write both from the same mesh and clip."
            )
        if isinstance(expected, str):
            origin.setdefault(expected, field.name)


def _spell(shape: tuple[str | int, ...]) -> str:
    return "[" + ", ".join(str(size) for size in shape) + "]"


def _check_present(arrays: Mapping[str, Any], where: str) -> None:
    missing = [field.name for field in fields_of(arrays) if field.name not in arrays]
    if {"uv", "faces_uv"} & set(missing) or not len(arrays["uv"]):
        raise ValueError(
            f"{where}: the template has no UVs (`uv` and `faces_uv`); unwrap it and export it with UVs."
        )
    if missing:
        raise ValueError(
            f"{where}: dataset `{missing[0]}` is missing; a sequence file needs "
            f"{', '.join(field.name for field in fields_of(arrays))}."
        )


def _check_type(field: Field, array: np.ndarray | FrameWindows, where: str) -> None:
    """Whole numbers serve as numbers; an empty array has no type worth a word (`np.array([])` is float)."""
    kinds, wanted = _SERVES[field.dtype[0]]
    if array.size and array.dtype.kind not in kinds:
        raise ValueError(f"{where}: `{field.name}` has type {array.dtype}; store {wanted}.")


def _check_not_empty(sizes: dict[str, int], where: str) -> None:
    names = {
        "t": "frames",
        "n": "garment vertices",
        "f": "garment faces",
        "b": "body vertices",
        "j": "joints",
        "d": "collider faces",
    }
    for letter, name in names.items():
        if sizes.get(letter) == 0:
            raise ValueError(f"{where}: there are 0 {name}; export it again with {name}.")


def _check_range(name: str, indices: np.ndarray, size: int, mesh: str, where: str) -> None:
    if not len(indices):
        return
    low, high = int(indices.min()), int(indices.max())
    if low < 0 or high >= size:
        raise ValueError(
            f"{where}: `{name}` holds index {low if low < 0 else high}, outside 0 … {size - 1}; "
            f"indices count from 0 and belong to {mesh}."
        )


def _check_finite(name: str, values: np.ndarray | FrameWindows, where: str) -> None:
    for _, rows in stretches(len(values)):
        finite = np.isfinite(values[rows])
        if finite.all():
            continue
        row = rows.start + int(np.argwhere(~finite)[0][0])
        raise ValueError(f"{where}: `{name}` is not finite in row {row}; export it again.")


def _check_weights(name: str, weights: np.ndarray, where: str) -> None:
    if not len(weights):
        return
    total = weights.sum(axis=1)
    worst = float(total[np.abs(total - 1).argmax()])
    if abs(worst - 1) > 1e-3:
        raise ValueError(f"{where}: a row of `{name}` sums to {worst:.4g}; normalise rows to 1.")


def check_parents(parents: np.ndarray, where: str, name: str) -> None:
    """Raise ValueError unless joint 0 is the root and every parent (`[j]`) comes before its children."""
    if parents[0] != -1 or not np.all((parents[1:] >= 0) & (parents[1:] < np.arange(1, len(parents)))):
        raise ValueError(
            f"{where}: `{name}` is {parents.tolist()}; joint 0 must be the root (-1) and every "
            "parent must come before its children."
        )


def check_uv(uv: np.ndarray, where: str) -> None:
    """Raise ValueError for texture coordinates `[u, 2]` outside 0 … 1."""
    low, high = float(uv.min()), float(uv.max())
    if low < -1e-4 or high > 1 + 1e-4:
        raise ValueError(f"{where}: `uv` runs from {low:.3g} to {high:.3g}; scale it into 0 … 1.")
