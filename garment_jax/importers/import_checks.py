"""Checks on a foreign clip before it is written: what would train nonsense is refused in a sentence."""

import numpy as np
from scipy.spatial import KDTree

from garment_jax.body.kinematics import pose_body
from garment_jax.importers.sources import ForeignClip
from garment_jax.io.sequence_writer import INT16_REACH
from garment_jax.io.validation import FARTHEST, STILL, check_motion, check_scene

WINDOW = 64  # frames in memory at once
_OUT_OF_SIGHT = 1000.0  # metres from the body's root: no cloth that it wears
_APART = 0.5  # metres between garment and body that mean another unit, up axis or motion


def check_clip(clip: ForeignClip, where: str) -> None:
    """Raise `ValueError`, with the file's name, for another unit, a root that jumps, cloth elsewhere."""
    check_scene(clip.scene, where)
    check_motion(clip.motion, where)
    if clip.windows is None:
        return
    first = next(clip.windows(1))[0]
    body = pose_body(clip.scene.body, clip.motion, slice(0, 1))[0]
    apart = float(np.median(KDTree(body).query(first)[0])) if (np.abs(first) < FARTHEST).all() else 0.0
    if apart > _APART:
        raise ValueError(
            f"{where}: in frame 0 the garment is {apart:.2f} m from the body; give the units and up "
            "axes (--clip-unit cm, --motion-up Z), or the motion that belongs to it."
        )


def choose_encoding(clip: ForeignClip, where: str) -> str:
    """Return how the frames are stored: "int16", or "float32" where the garment reaches too far for that.

    Raises `ValueError` for values that are not finite, with frame and vertex, and for a clip that is static.
    """
    assert clip.windows is not None
    low = high = None
    encoding, start = "int16", 0
    for V in clip.windows(WINDOW):
        root = clip.motion.root[start : start + len(V), None]
        _check_places(V, root, start, where)
        if np.abs(V - root).max() > INT16_REACH:
            encoding = "float32"
        low = V.min(axis=0) if low is None else np.minimum(low, V.min(axis=0))
        high = V.max(axis=0) if high is None else np.maximum(high, V.max(axis=0))
        start += len(V)
    if low is None or high is None or float((high - low).max()) < STILL:
        raise ValueError(f"{where} is static: no vertex moves in its {start} frames; leave it out.")
    return encoding


def _check_places(V: np.ndarray, root: np.ndarray, start: int, where: str) -> None:
    """Raise `ValueError` for a vertex of `V` `[k, n, 3]` that is nowhere, or out of the body's sight."""
    bad = ~(np.abs(V) < FARTHEST).all(axis=2)  # nor NaN
    if bad.any():
        frame, vertex = np.argwhere(bad)[0]
        raise ValueError(
            f"{where}: vertex {vertex} of frame {start + frame} is {V[frame, vertex].tolist()}; cut the clip "
            "before that frame or export it again."
        )
    far = (np.abs(V - root) > _OUT_OF_SIGHT).any(axis=2)
    if far.any():
        frame, vertex = np.argwhere(far)[0]
        apart = float(np.linalg.norm(V[frame, vertex] - root[frame, 0]))
        raise ValueError(
            f"{where}: vertex {vertex} of frame {start + frame} is {apart:.4g} m from the body's root; cut "
            "the clip before that frame or export it again."
        )
