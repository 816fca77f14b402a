"""A clip's motion as the networks take it: features, root carry-over and seed transforms (host)."""

from operator import itemgetter
from typing import NamedTuple

import jax
import numpy as np

from garment_jax.body.garment_skinning import garment_transforms
from garment_jax.body.motion_features import motion_features
from garment_jax.body.root_frame import carry_over, heading, headings
from garment_jax.body.seeds import Seeds, seed_transforms
from garment_jax.structs import FrameInput, Motion, Scene


class MotionInput(NamedTuple):
    """Everything a rollout reads of a motion; `t` frames."""

    x: FrameInput  # leaves [t, ...] float32
    R_seed: np.ndarray  # [s, m, 3, 3] float32, canonical -> posed, root frame; s = t unless asked for fewer
    t_seed: np.ndarray  # [s, m, 3] float32 metres
    root: np.ndarray  # [t, 3] float64 world position of the root joint, metres
    yaw: np.ndarray  # [t] float64 heading, radians

    def frame(self, t: int) -> FrameInput:
        """Return the network's input of frame `t`, without a frame axis."""
        return jax.tree.map(itemgetter(t), self.x)


def motion_input(
    motion: Motion,
    scene: Scene,
    seeds: Seeds,
    joints: tuple[str, ...],
    *,
    seed_frames: int | None = None,
) -> MotionInput:
    """Return the inputs of `motion` for the garment and body of `scene`.

    `joints` are those whose motion the network sees; seeds are posed in the first `seed_frames` frames (a
    rollout reads frame 0 alone, and their polar decompositions are most of the work). Raises `ValueError`
    for a joint the body lacks.
    """
    root, yaw = motion.root.astype(np.float64), headings(motion)
    posed = Motion(motion.rotations[:seed_frames], motion.root[:seed_frames], motion.fps)
    R_seed, t_seed = seed_transforms(seeds, scene, posed, yaw[:seed_frames])
    x = frame_inputs(motion, scene, joints, slice(0, len(root)))
    return MotionInput(x, R_seed, t_seed, root, yaw)


def frame_inputs(motion: Motion, scene: Scene, joints: tuple[str, ...], frames: slice) -> FrameInput:
    """Return the network's inputs of the frames `start:stop` of `motion`, leaves `[k, ...]` float32.

    Reads these frames and the one before them. Raises `ValueError` as `motion_input` does.
    """
    M = motion_features(motion, scene.body, joints, frames)
    first = max(frames.start - 1, 0)
    root, rotations = (
        motion.root[first : frames.stop].astype(np.float64),
        motion.rotations[first : frames.stop],
    )
    turn, shift = carry_over(root, heading(rotations[:, 0]))
    before = frames.start - first
    own = Motion(rotations[before:], motion.root[frames], motion.fps)
    return FrameInput(M, turn[before:], shift[before:], *garment_transforms(own, scene))
