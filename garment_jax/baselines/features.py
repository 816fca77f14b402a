"""Which part of our motion features a baseline's network sees, in deviations from the training set's mean."""

from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from garment_jax.body.motion_features import chosen_joints, motion_features
from garment_jax.config import Config
from garment_jax.dataset.template import Template
from garment_jax.model.motion.network import normalise_motion
from garment_jax.model.store import Model
from garment_jax.structs import Motion, RiggedBody, Scene

TILT, ROTATION, VELOCITY, YAW_RATE = 6, 6, 3, 1  # widths of M's parts, see body/motion_features.py
Reads = Literal["pose", "pose and root", "pose and velocities"]


def columns(body: RiggedBody, config: Config, reads: Reads) -> np.ndarray:
    """Return the columns of M that a method reads, or all of them with `baselines.inputs = "ours"`.

    pose                 the joints' rotations relative to their parents, nothing of the root
    pose and root        with the root's tilt, velocity and yaw rate
    pose and velocities  with the joints' velocities as well: all but their positions
    """
    k = len(chosen_joints(body, config.body.motion_joints))
    rotations = TILT + ROTATION * k
    root = rotations + VELOCITY + YAW_RATE
    ends = {"pose": (TILT, rotations), "pose and root": (0, root), "pose and velocities": (0, root + 3 * k)}
    if config.baselines.inputs == "ours":
        return np.arange(root + 6 * k)
    return np.arange(*ends[reads])


def normalised(
    M: Float[Array | np.ndarray, "t d"], template: Template, chosen: Int[np.ndarray, " c"]
) -> Float[np.ndarray, "t c"]:
    """Return the `chosen` columns of features `M` in deviations, held near the training range."""
    return np.asarray(normalise_motion(jnp.asarray(M), template), np.float32)[:, chosen]


def read_motion(
    motion: Motion, scene: Scene, model: Model, template: Template, chosen: Int[np.ndarray, " c"]
) -> Float[np.ndarray, "t c"]:
    """Return the `chosen` columns of a motion's features as `normalised` does."""
    joints, frames = model.config.body.motion_joints, slice(0, len(motion.root))
    return normalised(motion_features(motion, scene.body, joints, frames), template, chosen)
