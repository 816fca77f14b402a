"""SMPL body models (.npz, .pkl): SMPL, SMPL-H and SMPL-X, the user's own copy; their pickles without chumpy.

The template is in metres, Y up, facing +Z, its arms spread; its origin is near the chest, so the feet are
below zero. Pose blend shapes (`posedirs`) are not read: a sequence's body is skinned linearly.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.io.formats.npz import npz_names, read_npz
from garment_jax.io.formats.number_arrays import is_index, number_array
from garment_jax.io.formats.pickles import load_pickle

ARRAYS = ("v_template", "shapedirs", "J_regressor", "weights", "kintree_table", "f")
_FARTHEST = 1e9  # of a number, in any unit of length
_BODY = (
    *("pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle"),
    *("right_ankle", "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head"),
    *("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"),
)
_FINGERS = tuple(
    f"{side}_{finger}{k}"
    for side in ("left", "right")
    for finger in ("index", "middle", "pinky", "ring", "thumb")
    for k in (1, 2, 3)
)
# by number of joints; 22 are the body's alone, as some motions have it
JOINT_NAMES = {
    22: _BODY,
    24: (*_BODY, "left_hand", "right_hand"),
    52: (*_BODY, *_FINGERS),
    55: (*_BODY, "jaw", "left_eye_smplhf", "right_eye_smplhf", *_FINGERS),
}
_BODY_PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19)


# Offsets of the mean neutral shape's joints from their parents, metres (the pelvis: from the model's origin).
_BODY_OFFSETS = (
    *((-0.0022, -0.2408, 0.0286), (0.0586, -0.0823, -0.0177), (-0.0603, -0.0905, -0.0135)),
    *((0.0044, 0.1244, -0.0384), (0.0435, -0.3865, 0.0080), (-0.0433, -0.3837, -0.0048)),
    *((0.0045, 0.1380, 0.0268), (-0.0148, -0.4269, -0.0374), (0.0191, -0.4200, -0.0346)),
    *((-0.0023, 0.0560, 0.0029), (0.0411, -0.0603, 0.1220), (-0.0348, -0.0621, 0.1303)),
    *((-0.0134, 0.2116, -0.0335), (0.0717, 0.1140, -0.0189), (-0.0830, 0.1125, -0.0237)),
    *((0.0101, 0.0889, 0.0504), (0.1229, 0.0452, -0.0190), (-0.1132, 0.0469, -0.0085)),
    *((0.2553, -0.0156, -0.0229), (-0.2601, -0.0144, -0.0313), (0.2657, 0.0127, -0.0074)),
    (-0.2691, 0.0068, -0.0060),
)
_HAND = (
    0.08  # metres from the wrist, or from one joint of a finger to the next: no limb's direction hangs on it
)


class SmplBody(NamedTuple):
    """A body model in its rest pose; metres, Y up, the model's own origin."""

    vertices: np.ndarray  # [b, 3] float64
    faces: np.ndarray  # [g, 3] int32
    joints: np.ndarray  # [j, 3] float64
    parents: np.ndarray  # [j] int32, -1 for the root
    joint_names: tuple[str, ...]
    skin_weights: np.ndarray  # [b, j] float64, rows sum to 1
    notes: tuple[str, ...]  # what was left out


def standard_parents(count: int) -> np.ndarray:
    """Return the parents `[j]` int32 of a standard skeleton of the SMPL family with `count` joints."""
    parents: list[int] = [*_BODY_PARENTS]
    names = JOINT_NAMES[count]
    for name in names[22:]:
        hand = names.index("left_wrist" if name.startswith("left_") else "right_wrist")
        head = name == "jaw" or "_eye_" in name
        first = not name.endswith(("2", "3"))
        parents.append(names.index("head") if head else hand if first else len(parents) - 1)
    return np.array(parents, np.int32)


def standard_joints(count: int) -> np.ndarray:
    """Return the rest positions `[j, 3]` of the family's mean body, metres; hands and face only roughly."""
    parents, names = standard_parents(count), JOINT_NAMES[count]
    joints = np.zeros((count, 3))
    for j, name in enumerate(names):
        side = 1.0 if name.startswith("left") else -1.0
        offset = _BODY_OFFSETS[j] if j < len(_BODY_OFFSETS) else (side * _HAND, 0.0, 0.0)
        joints[j] = np.array(offset) + (joints[parents[j]] if j else 0.0)
    return joints


def is_smpl(path: str | Path) -> bool:
    """Return whether an `.npz` file is a body model of the SMPL family; raises as `read_npz`."""
    return "v_template" in npz_names(path)


def read_smpl(path: str | Path, *, betas: np.ndarray | None = None) -> SmplBody:
    """Read a body model of the SMPL family, in the shape `betas` `[k]` (the mean shape by default).

    Raises `FileNotFoundError`, `OSError` for a damaged file and `ValueError` for one that holds anything but
    plain data, lacks an array, whose arrays do not fit together, or has fewer shapes than `betas`.
    """
    path = Path(path)
    arrays = _read(path)
    missing = [name for name in ARRAYS if name not in arrays and (name != "shapedirs" or betas is not None)]
    if missing:
        raise ValueError(f"{path}: array {missing[0]!r} is missing; a body model has {', '.join(ARRAYS)}.")
    template = _floats(arrays, "v_template", ("b", 3), path)
    size = len(template)
    vertices = template + _shape_offsets(arrays, betas, size, path)
    regressor = _floats(arrays, "J_regressor", ("j", size), path)
    count = len(regressor)
    weights = _floats(arrays, "weights", (size, count), path)
    sums = weights.sum(axis=1, keepdims=True)
    if np.abs(sums - 1).max() > 1e-2:
        raise ValueError(
            f"{path}: a row of 'weights' sums to {sums[np.abs(sums - 1).argmax(), 0]:.4g}, not 1."
        )
    return SmplBody(
        vertices,
        _faces(arrays["f"], size, path),
        regressor @ vertices,
        _parents(arrays["kintree_table"], count, path),
        JOINT_NAMES.get(count, tuple(f"joint_{k}" for k in range(count))),
        weights / sums,
        ("pose blend shapes (posedirs) are left out: the body is skinned linearly",)
        if "posedirs" in arrays
        else (),
    )


def _read(path: Path) -> dict[str, Any]:
    """Return the file's arrays by name; of `posedirs`, the largest, nothing but that it is there."""
    if path.suffix.lower() != ".pkl":
        arrays = dict(read_npz(path, ARRAYS))
        return arrays | ({"posedirs": True} if "posedirs" in npz_names(path) else {})
    model = load_pickle(path)
    if not isinstance(model, dict) or "v_template" not in model:
        raise ValueError(f"{path} is no body model: it holds no 'v_template'; name SMPL's own file.")
    return {name: model[name] for name in (*ARRAYS, "posedirs") if name in model}


def _floats(arrays: dict[str, Any], name: str, shape: tuple[int | str, ...], path: Path) -> np.ndarray:
    """Return a finite array as float64; letters in `shape` stand for any size but 0."""
    array = number_array(arrays[name], name, path)
    found = array.shape
    sizes = zip(found, shape, strict=False)
    if len(found) != len(shape) or any(n != want if isinstance(want, int) else n == 0 for n, want in sizes):
        raise ValueError(f"{path}: {name!r} has shape {found}, expected {_spell(shape)}.")
    if not (np.abs(array) < _FARTHEST).all():  # nor NaN
        raise ValueError(f"{path}: {name!r} is not finite, or beyond {_FARTHEST:g}; copy the model again.")
    return array.astype(np.float64)


def _spell(shape: tuple[int | str, ...]) -> str:
    return "[" + ", ".join(map(str, shape)) + "]"


def _shape_offsets(arrays: dict[str, Any], betas: np.ndarray | None, size: int, path: Path) -> np.ndarray:
    """Return how the shape moves the vertices, `[b, 3]`."""
    betas = np.zeros(0) if betas is None else np.asarray(betas, np.float64)
    if betas.ndim != 1 or not np.isfinite(betas).all():
        raise ValueError(f"betas of shape {betas.shape} are no shape of one body; give one finite row.")
    used = np.trim_zeros(betas, "b")
    if not len(used):
        return np.zeros((size, 3))
    directions = _floats(arrays, "shapedirs", (size, 3, "k"), path)
    if len(used) > directions.shape[2]:
        raise ValueError(
            f"{path} has {directions.shape[2]} shapes, and {len(used)} betas are given; leave the others out."
        )
    return directions[:, :, : len(used)] @ used


def _faces(given: Any, size: int, path: Path) -> np.ndarray:
    faces = number_array(given, "f", path)
    if faces.ndim != 2 or not len(faces) or faces.shape[1] != 3 or not is_index(faces, size):
        raise ValueError(
            f"{path}: 'f' must be triangles [g, 3] of the {size} vertices; copy the model again."
        )
    return faces.astype(np.int32)


def _parents(given: Any, count: int, path: Path) -> np.ndarray:
    """Return the parents of a table [2, j] of parents and ids; the root's is -1, or that without a sign."""
    table = number_array(given, "kintree_table", path)
    good = table.shape == (2, count) and is_index(table[1], 2**32) and is_index(table[0, 1:], 2**32)
    column = {int(number): k for k, number in enumerate(table[1])} if good else {}
    parents = [-1, *(column.get(int(number), -1) for number in table[0, 1:])] if good else []
    if not good or any(not 0 <= parent < k for k, parent in enumerate(parents) if k):
        raise ValueError(
            f"{path}: 'kintree_table' must be [2, {count}], parents before children; copy the model again."
        )
    return np.array(parents, np.int32)
