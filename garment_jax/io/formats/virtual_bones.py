"""VirtualBones clips (.npz): `pose` [t, 52, 3], `trans` [t, 3], `sim_res` [t, n, 3]; Z up."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from garment_jax.body.rates import RATE_KEYS, rate_in
from garment_jax.io.formats.npz import npz_names, read_npz
from garment_jax.io.formats.number_arrays import number_array
from garment_jax.io.formats.rotation_vectors import SmplMotion, read_poses, read_translation


class VirtualBonesClip(NamedTuple):
    """A simulated clip in its file's own unit, Z up; the unit is not in the file, the rate seldom."""

    motion: SmplMotion
    vertices: np.ndarray  # [t, n, 3] float32


def is_virtual_bones(path: str | Path) -> bool:
    """Return whether an `.npz` file holds such a clip; raises as `read_npz`."""
    return {"pose", "trans"} <= set(npz_names(path))


def read_virtual_bones(path: str | Path) -> VirtualBonesClip:
    """Read a clip: rotation vectors, translations and the garment.

    Raises `FileNotFoundError`, `OSError` for a damaged file and `ValueError` for what does not fit. Frames
    that are not finite are not looked for in `sim_res`: the clip's reader does.
    """
    path = Path(path)
    arrays = read_npz(path, ("pose", "trans", "sim_res", *RATE_KEYS))
    missing = [name for name in ("pose", "trans", "sim_res") if name not in arrays]
    if missing:
        raise ValueError(
            f"{path}: array {missing[0]!r} is missing; a VirtualBones clip has pose, trans and sim_res."
        )
    poses = read_poses(arrays["pose"], "pose", path)
    translation = read_translation(arrays["trans"], "trans", len(poses), path)
    vertices = number_array(arrays["sim_res"], "sim_res", path)
    if vertices.ndim != 3 or not vertices.size or vertices.shape[::2] != (len(poses), 3):
        raise ValueError(
            f"{path}: 'sim_res' has shape {vertices.shape}; the poses ask for [{len(poses)}, n, 3]."
        )
    with np.errstate(over="ignore"):  # what float32 cannot hold is infinite, and found with the rest
        vertices = vertices.astype(np.float32, copy=False)
    motion = SmplMotion(poses, translation, None, rate_in(arrays, path), None, "Z")
    return VirtualBonesClip(motion, vertices)
