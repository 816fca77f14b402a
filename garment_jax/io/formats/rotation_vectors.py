"""Poses as rotation vectors: what all motions of the SMPL family come to, whatever file they are in."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.io.formats.number_arrays import number_array
from garment_jax.io.formats.smpl import JOINT_NAMES

_FARTHEST = 1e9  # of a number in radians, or in any unit of length


class SmplMotion(NamedTuple):
    """A motion of the SMPL family in its file's own unit and axes.

    The root joint is at its place in the body's rest pose plus `translation`.
    """

    poses: np.ndarray  # [t, j, 3] float64 rotation vectors, radians, from the parent
    translation: np.ndarray  # [t, 3] float64
    betas: np.ndarray | None  # [k] float64 the body's shape, None where the file does not say
    fps: float | None  # None where the file does not say
    unit: float | None  # metres per unit
    up: str  # "Y" or "Z"
    notes: tuple[str, ...] = ()
    usual_fps: float | None = None  # of the format, where its files do not say

    @property
    def rate(self) -> float | None:
        """Frames a second: the file's own, else its format's."""
        return self.fps or self.usual_fps

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints, in the family's order."""
        return JOINT_NAMES[self.poses.shape[1]]


def read_poses(poses: Any, name: str, path: Path) -> np.ndarray:
    """Return poses `[t, 3 j]` or `[t, j, 3]` as `[t, j, 3]`; `ValueError` for another skeleton's."""
    poses = check_numbers(poses, name, path)
    numbers = int(np.prod(poses.shape[1:])) if poses.ndim in (2, 3) else 0
    if numbers // 3 not in JOINT_NAMES or numbers % 3 or (poses.ndim == 3 and poses.shape[2] != 3):
        raise ValueError(
            f"{path}: {name!r} has shape {poses.shape}; a pose of the SMPL family has "
            f"{', '.join(str(3 * count) for count in JOINT_NAMES)} numbers a frame."
        )
    return poses.reshape(len(poses), -1, 3)


def read_translation(translation: Any, name: str, frames: int, path: Path) -> np.ndarray:
    """Return translations `[t, 3]`; `ValueError` where they are not one a frame."""
    translation = check_numbers(translation, name, path)
    if translation.shape != (frames, 3):
        raise ValueError(
            f"{path}: {name!r} has shape {translation.shape}, but the poses ask for {(frames, 3)}."
        )
    return translation


def check_numbers(array: Any, name: str, path: Path) -> np.ndarray:
    """Return finite numbers as a float64 array of their own; `ValueError` for anything else, and for none."""
    array = np.array(number_array(array, name, path), np.float64)
    if not array.size:
        raise ValueError(f"{path}: {name!r} has shape {array.shape}; there is nothing in it.")
    bad = ~(np.abs(array) < _FARTHEST)  # nor NaN
    if bad.any():
        value, where = array.flat[int(bad.argmax())], "; copy it again"
        if array.ndim:
            where = f" in frame {np.argwhere(bad)[0][0]}; cut that part out of the clip"
        what = f"{value:.3g}, as no motion is" if np.isfinite(value) else "not finite"
        raise ValueError(f"{path}: {name!r} is {what}{where}.")
    return array
