"""Poses as rotation vectors: what all motions of the SMPL family come to, whatever file they are in."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.formats.smpl import JOINT_NAMES


class SmplMotion(NamedTuple):
    """A motion of the SMPL family in its file's own unit and axes.

    The root joint is at its place in the body's rest pose plus `translation`.
    """

    poses: np.ndarray  # [t, j, 3] float64 rotation vectors, radians, from the parent
    translation: np.ndarray  # [t, 3] float64
    betas: np.ndarray | None  # [k] float64 the body's shape, None where the file does not say
    fps: float | None  # None where the format does not say
    unit: float | None  # metres per unit
    up: str  # "Y" or "Z"
    notes: tuple[str, ...] = ()

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
    """Return an array as float64; `ValueError` for anything but finite numbers, and for none."""
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        kind = array.dtype if isinstance(array, np.ndarray) else type(array).__name__
        raise ValueError(f"{path}: {name!r} is of type {kind}, not an array of numbers; save it as one.")
    if not array.size:
        raise ValueError(f"{path}: {name!r} has shape {array.shape}; there is nothing in it.")
    array = array.astype(np.float64)
    if not np.isfinite(array).all():
        row = int(np.argwhere(~np.isfinite(array.reshape(len(array), -1) if array.ndim else array))[0][0])
        raise ValueError(f"{path}: {name!r} is not finite in frame {row}; cut that part out of the clip.")
    return array


def check_rate(rate: Any, name: str, path: Path) -> float:
    """Return a rate in frames a second; `ValueError` for what is none."""
    value = np.asarray(rate)
    if value.size != 1 or value.dtype.kind not in "fiu" or not 1 <= float(value.reshape(())) <= 1e4:
        shown = str(rate)[:40] if value.size == 1 else f"of shape {value.shape}"
        raise ValueError(f"{path}: {name!r} is {shown}, not 1 to 10000 frames a second; give its true rate.")
    return float(value.reshape(()))
