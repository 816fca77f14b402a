"""One long motion out of many parts, each begun and ended in the same calm pose.

All of it goes through the model once: one compiled program, and the path that a user's motion takes. Every
part is blended in and out, so that what is extreme is the part itself, and followed by the calm pose held.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from garment_jax.body.looped_motion import blended_rotations
from garment_jax.body.preroll import smoothstep
from garment_jax.body.root_frame import heading, yaw_matrix
from garment_jax.structs import Motion

BLEND, HOLD = 45, 90  # frames from a part into the calm pose, and of the calm pose after it
SLOWLY = 150  # frames from the canonical pose into the calm one, before everything else


class Part(NamedTuple):
    """A stretch of the long motion; frames of it."""

    name: str
    start: int  # first frame of the part itself
    stop: int  # first frame of the blend into the calm pose
    calm: int  # first frame of the calm pose held
    end: int  # one past the last


def make_script(calm: Motion, parts: Sequence[tuple[str, Motion]]) -> tuple[Motion, list[Part]]:
    """Return the motion of all parts and where each lies; the first is the calm pose, reached slowly.

    `calm` is a motion of one frame. A part goes on where, and whither, the one before it stood; its own
    heights stay. All at the calm motion's frame rate.
    """
    canonical = Motion(_upright(calm), calm.root[:1].copy(), calm.fps)
    pieces, places = [canonical], []
    for name, motion in (("calm pose reached slowly", calm), *parts):
        blend = SLOWLY if not places else BLEND
        pieces.append(_bridge(pieces[-1], motion, blend))
        start = _length(pieces)
        pieces.append(_continued(pieces[-1], motion))
        stop = _length(pieces)
        pieces.append(_bridge(pieces[-1], calm, BLEND))
        at = _length(pieces)
        held = _continued(pieces[-1], calm)
        pieces.append(Motion(np.repeat(held.rotations, HOLD, 0), np.repeat(held.root, HOLD, 0), calm.fps))
        places.append(Part(name, start, stop, at, _length(pieces)))
    rotations = np.concatenate([piece.rotations for piece in pieces]).astype(np.float32)
    return Motion(rotations, np.concatenate([piece.root for piece in pieces]), calm.fps), places


def _upright(calm: Motion) -> np.ndarray:
    """Return the canonical rotations `[1, j, 3, 3]` at the calm pose's heading."""
    turn = yaw_matrix(heading(calm.rotations[:1, 0]))
    return np.repeat(turn[:, None], calm.rotations.shape[1], axis=1)


def _length(pieces: Sequence[Motion]) -> int:
    return sum(len(piece.root) for piece in pieces)


def _continued(before: Motion, motion: Motion) -> Motion:
    """Return `motion` turned and moved so that it begins at the heading and place where `before` ends."""
    ends, begins = (
        float(heading(m.rotations[k : k + 1, 0])[0]) for m, k in ((before, len(before.root) - 1), (motion, 0))
    )
    turn = yaw_matrix(np.array(ends - begins))
    root = (motion.root.astype(np.float64) - motion.root[0]) @ turn.T
    root[:, [0, 2]] += before.root[-1, [0, 2]]
    root[:, 1] = motion.root[:, 1]
    return Motion(turn @ motion.rotations.astype(np.float64), root, motion.fps)


def _bridge(before: Motion, motion: Motion, frames: int) -> Motion:
    """Return `frames` frames from the last pose of `before` to the first of `motion`, on the spot."""
    after = _continued(before, Motion(motion.rotations[:1], motion.root[:1], motion.fps))
    u = smoothstep((np.arange(frames) + 1) / (frames + 1))
    a, b = (np.repeat(R.astype(np.float64), frames, 0) for R in (before.rotations[-1:], after.rotations))
    root = before.root[-1:] + u[:, None] * (after.root - before.root[-1:])
    return Motion(blended_rotations(a, b, u), root, motion.fps)
