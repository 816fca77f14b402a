"""Motions in archives and pickles: read as `import` reads them, then looked at array by array."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from garment_jax.importers.finding import Finding, refusal, worst
from garment_jax.importers.motions import read_smpl_motion
from garment_jax.io.formats.number_arrays import is_index, number_array
from garment_jax.io.validation import FARTHEST
from garment_jax.validation.motion_checks import READ, check_arrays

_POSES = ("poses", "pose", "smpl_poses")
_POINTS = {**dict.fromkeys(("trans", "translation", "smpl_trans", "faces"), 2), "vertices": 3, "sim_res": 3}


def check_motion_arrays(
    path: Path, arrays: Mapping[str, Any], *, fps: float | None = None, content: Any = None
) -> list[Finding]:
    """Return the findings on a motion of the SMPL family: faults by frame, else the reader's refusal.

    `arrays` by name as they stand in the file; `content` is a pickle's, where it was loaded already.
    """
    refused = None
    try:
        motion, _ = read_smpl_motion(path, content)
        fps = fps or motion.rate
    except (ValueError, OSError) as error:
        refused = refusal(error, path)
    usable = {}
    for name in READ:
        if arrays.get(name) is not None:
            usable |= _usable(name, arrays[name], path)
    vertices = usable.get("vertices", usable.get("sim_res"))
    if "faces" in usable and (vertices is None or not is_index(usable["faces"], vertices.shape[1])):
        del usable["faces"]
    found = check_arrays(usable, fps=fps) if usable.keys() & {*_POSES, "vertices", "sim_res"} else []
    if refused is None or worst(found) == "error":
        return found
    return [refused, *found]


def _usable(name: str, value: Any, path: Path) -> dict[str, np.ndarray]:
    """Return the array under its name; nothing where it is none of numbers or has another number of axes."""
    try:
        array = number_array(value, name, path)
    except ValueError:
        return {}
    if array.dtype.kind == "f":
        array = np.where(np.abs(array) < FARTHEST, array, np.nan)  # named with what is not finite
    if name in _POSES:
        good = array.ndim in (2, 3) and array.size > 0
    elif name in _POINTS:
        good = array.ndim == _POINTS[name] and array.size > 0 and array.shape[-1] == 3
    else:
        good = array.size == 1 and bool(np.isfinite(array).all()) and array.item() > 0
    return {name: array} if good else {}
