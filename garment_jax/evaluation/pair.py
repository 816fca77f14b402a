"""Which two sequence files may be compared: same garment, same motion, finite vertices."""

import numpy as np

from garment_jax.io.sequence import Sequence

ROOT_TOLERANCE = 1e-3  # metres
ROTATION_TOLERANCE = 1e-3  # entries of a rotation matrix, about 0.06 degrees


PREDICT = "predict with the truth file as the motion."


def check_pair(pred: Sequence, truth: Sequence, *, remedy: str = PREDICT) -> None:
    """Raise `ValueError` naming the first thing in which `pred` and `truth` differ, with a `remedy`."""
    check_order(pred, truth)
    check_garment(pred, truth)
    if pred.frames != truth.frames:
        raise ValueError(
            f"{pred.path} has {pred.frames} frames but {truth.path} has {truth.frames}; {remedy}"
        )
    if not np.isclose(pred.fps, truth.fps):
        raise ValueError(
            f"{pred.path} runs at {pred.fps:g} fps but {truth.path} at {truth.fps:g}; "
            "resample one of them to the other's rate."
        )
    check_motion(pred, truth, truth.frames, remedy=remedy)


def check_order(pred: Sequence, truth: Sequence) -> None:
    """Raise `ValueError` where the files say that they are given the wrong way round."""
    kinds = [clip.attributes.get("kind") for clip in (pred, truth)]
    if kinds == ["simulated", "predicted"]:
        raise ValueError(
            f"{pred.path} is simulated and {truth.path} is predicted; give the prediction first, then the "
            "truth."
        )


def check_garment(pred: Sequence, truth: Sequence) -> None:
    """Raise `ValueError` unless both have the same vertices and faces."""
    ours, theirs = pred.scene.garment, truth.scene.garment
    if len(ours.template) != len(theirs.template):
        raise ValueError(
            f"{pred.path} has {len(ours.template)} vertices but {truth.path} has "
            f"{len(theirs.template)}; compare clips of one garment."
        )
    if not np.array_equal(ours.faces, theirs.faces):
        different = "count" if ours.faces.shape != theirs.faces.shape else "vertices"
        raise ValueError(
            f"the faces of {pred.path} ({len(ours.faces)}) and {truth.path} ({len(theirs.faces)}) differ "
            f"in {different}; import both with the same template."
        )


def check_motion(pred: Sequence, truth: Sequence, frames: int, *, remedy: str = PREDICT) -> None:
    """Raise `ValueError` unless the first `frames` frames, which both must have, move alike."""
    ours, theirs = pred.motion, truth.motion
    if ours.rotations.shape[1] != theirs.rotations.shape[1]:
        raise ValueError(
            f"{pred.path} has {ours.rotations.shape[1]} joints but {truth.path} has "
            f"{theirs.rotations.shape[1]}; compare clips of one body."
        )
    away = np.abs(ours.root[:frames] - theirs.root[:frames]).max(axis=-1)
    turned = np.abs(ours.rotations[:frames] - theirs.rotations[:frames]).max(axis=(1, 2, 3))
    bad = (away > ROOT_TOLERANCE) | (turned > ROTATION_TOLERANCE)
    if bad.any():
        frame = int(np.argmax(bad))
        raise ValueError(
            f"the motions of {pred.path} and {truth.path} differ at frame {frame} (root by "
            f"{100 * float(away[frame]):.2f} cm, rotations by {float(turned[frame]):.3f}); "
            f"{remedy}"
        )


def read_finite(clip: Sequence, start: int, stop: int) -> np.ndarray:
    """Return the clip's vertices `[k, n, 3]` of frames start to stop, world metres, all finite.

    Raises `ValueError` with the clip, frame and vertex of the first value that is not.
    """
    V = clip.read(start, stop)
    finite = np.isfinite(V).all(axis=-1)
    if not finite.all():
        frame, vertex = np.argwhere(~finite)[0]
        raise ValueError(
            f"{clip.path}: vertex {vertex} of frame {start + frame} is not finite; "
            "the clip is damaged or the rollout diverged, make it again."
        )
    return V
