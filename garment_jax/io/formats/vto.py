"""vto-dataset clips (.pkl): a garment simulated on SMPL (24 joints); metres, Y up, 30 fps.

Two spellings are about: `poses` [t, 75], of which three numbers are the translation, and `shapes`; or `pose`
[t, 72], `translation` and `shape`. Both hold `vertices` and `faces`.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.body.rates import rate_in
from garment_jax.io.formats.number_arrays import is_index, number_array
from garment_jax.io.formats.pickles import load_pickle
from garment_jax.io.formats.rotation_vectors import SmplMotion, check_numbers, read_poses, read_translation

_FPS = 30.0
_TURN = 2 * np.pi  # radians; a rotation vector beyond a full turn is none that programs write
_FAST = 0.5  # radians or metres in a frame at 30 fps


class VtoClip(NamedTuple):
    """A simulated clip: the garment in the posed world frame."""

    motion: SmplMotion
    vertices: np.ndarray  # [t, n, 3]
    faces: np.ndarray  # [f, 3] int32
    betas: np.ndarray  # [t, k] float64 the body's shape in every frame


def is_vto(content: Any) -> bool:
    """Return whether a pickle's content is such a clip."""
    return isinstance(content, dict) and ("poses" in content or "pose" in content)


def read_vto(path: str | Path, content: Any = None) -> VtoClip:
    """Read a clip in either spelling; `content` is that of the pickle, where it was loaded already.

    Raises `FileNotFoundError`, `OSError` for a damaged file and `ValueError`, by key, for what is missing or
    does not fit, and for anything in the pickle but plain data. `motion.notes` says where the 75 numbers
    look as if the translation came first. Vertices are not searched for values that are not finite.
    """
    path = Path(path)
    content = load_pickle(path) if content is None else content
    if not is_vto(content):
        raise ValueError(f"{path} is no vto-dataset clip: it holds neither 'poses' nor 'pose'.")
    long = "poses" in content
    poses, translation, notes = _split(content, path) if long else _apart(content, path)
    betas = _betas(content, "shapes" if long else "shape", len(poses), path)
    motion = SmplMotion(poses, translation, betas[0], rate_in(content, path), 1.0, "Y", notes, _FPS)
    vertices = _vertices(content, len(poses), path)
    return VtoClip(motion, vertices, _faces(content, vertices.shape[1], path), betas)


def _need(content: dict, name: str, path: Path) -> Any:
    if name not in content:
        raise ValueError(
            f"{path}: {name!r} is missing; a vto-dataset clip has poses, shapes, vertices, faces."
        )
    return content[name]


def _apart(content: dict, path: Path) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    poses = read_poses(content["pose"], "pose", path)
    return poses, read_translation(_need(content, "translation", path), "translation", len(poses), path), ()


def _split(content: dict, path: Path) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return the poses and translations of [t, 75], or of [t, 72] with a translation of its own."""
    poses = check_numbers(content["poses"], "poses", path)
    if poses.ndim != 2 or poses.shape[1] not in (72, 75):
        raise ValueError(f"{path}: 'poses' has shape {poses.shape}, expected [t, 75] or [t, 72].")
    if poses.shape[1] == 72:
        return _apart({"pose": poses} | content, path)
    notes = ()
    if _unlikeness(poses[:, 3:], poses[:, :3]) < _unlikeness(poses[:, :72], poses[:, 72:]):
        notes = (
            "'poses' look as if the translation came first, and 72 angles and then it are documented; check "
            "that the body is inside the garment",
        )
    return poses[:, :72].reshape(len(poses), 24, 3), poses[:, 72:], notes


def _unlikeness(angles: np.ndarray, translation: np.ndarray) -> float:
    """Return how little `angles` [t, 72] look like joints and `translation` like a walk.

    Joints stay within a turn and move little from frame to frame. Rest pose parts that never move, the feet's
    ends and the hands (joints 10, 11, 22 and 23), are the best witness: shifted by three numbers they are
    others. The translation is the column triple that travels.
    """
    joints = angles.reshape(len(angles), 24, 3)
    beyond = np.maximum(np.linalg.norm(joints, axis=2) - _TURN, 0).sum()
    jumps = np.maximum(np.abs(np.diff(joints, axis=0)) - _FAST, 0).sum()
    ends = np.abs(joints[:, [10, 11, 22, 23]]).mean()
    return float(beyond + jumps + ends - 0.1 * min(np.ptp(translation, axis=0).max(), 1.0))


def _betas(content: dict, name: str, frames: int, path: Path) -> np.ndarray:
    betas = np.atleast_1d(check_numbers(_need(content, name, path), name, path))
    if betas.ndim == 1:
        betas = betas[None]
    if betas.ndim != 2 or len(betas) not in (1, frames):
        raise ValueError(f"{path}: {name!r} has shape {betas.shape}, expected [{frames}, 10].")
    return np.broadcast_to(betas, (frames, betas.shape[1]))


def _vertices(content: dict, frames: int, path: Path) -> np.ndarray:
    vertices = number_array(_need(content, "vertices", path), "vertices", path)
    if vertices.ndim != 3 or not vertices.size or vertices.shape[::2] != (frames, 3):
        raise ValueError(
            f"{path}: 'vertices' has shape {vertices.shape}; the poses ask for [{frames}, n, 3]."
        )
    return vertices


def _faces(content: dict, count: int, path: Path) -> np.ndarray:
    faces = number_array(_need(content, "faces", path), "faces", path)
    if faces.ndim != 2 or not len(faces) or faces.shape[1] != 3 or not is_index(faces, count):
        raise ValueError(f"{path}: 'faces' must be triangles [f, 3] of the {count} vertices.")
    return faces.astype(np.int32)
