"""How a clip begins: the cloth settles in the canonical pose, the body takes the first pose and waits."""

from typing import NamedTuple

import numpy as np

from garment_jax.body.preroll import into_first_pose, smoothstep
from garment_jax.body.root_frame import heading, yaw_matrix
from garment_jax.simulation.settings import ClothSettings
from garment_jax.structs import Motion, RiggedBody

UP = 1  # Y


class ClothState(NamedTuple):
    """A cloth at rest or in motion (plain arrays; root frame: the root at 0, heading +Z)."""

    positions: np.ndarray  # [n, 3] float32, metres
    velocities: np.ndarray  # [n, 3] float32, m/s


def start_motion(motion: Motion, body: RiggedBody, settings: ClothSettings) -> Motion:
    """Return the frames before a clip's first: canonical pose, a smoothstep blend, the first pose.

    `settings.settle + blend + hold` frames, as `into_first_pose`; with `settings.turn_in` the body turns to
    its first heading meanwhile, from +Z, and moves from the canonical height to its own, which leaves other
    folds. Raises `ValueError` for a motion of another body or frame rate.
    """
    check_motion(motion, body, settings)
    u = smoothstep((np.arange(settings.blend) + 1.0) / max(settings.blend, 1))
    share = np.concatenate([np.zeros(settings.settle), u, np.ones(settings.hold)])
    if not settings.turn_in:
        return into_first_pose(motion, share)
    before = into_first_pose(motion, share, yaw=0.0)
    root = before.root.astype(np.float64)
    root[:, UP] += (1.0 - share) * (body.joints[0, UP] - root[:, UP])
    return before._replace(root=root)


def canonical_motion(body: RiggedBody, frames: int, fps: float) -> Motion:
    """Return `frames` frames of the canonical pose, its root at the origin."""
    rotations = np.tile(np.eye(3), (frames, len(body.joints), 1, 1))
    return Motion(rotations, np.zeros((frames, 3)), fps)


def check_motion(motion: Motion, body: RiggedBody, settings: ClothSettings, name: str = "the motion") -> None:
    """Raise `ValueError` for a motion (called `name`) that is empty, of another body or at another rate."""
    if not len(motion.root):
        raise ValueError(f"{name} has no frames; give one at least.")
    if motion.rotations.shape[1] != len(body.joints):
        raise ValueError(
            f"{name} turns {motion.rotations.shape[1]} joints and the body has {len(body.joints)}; "
            "retarget it to the body."
        )
    if abs(motion.fps - settings.fps) > 1e-3 * settings.fps:
        raise ValueError(
            f"{name} has {motion.fps:g} fps, the settings {settings.fps:g}; resample it, or simulate at its "
            f"rate (--cloth fps={motion.fps:g})."
        )


def begun(
    motion: Motion, body: RiggedBody, settings: ClothSettings, drape: ClothState
) -> tuple[Motion, ClothState]:
    """Return `motion` with the frames before it, from the last that settles on, and `drape` at its first.

    As many frames before for every motion. Raises `ValueError` as `start_motion`.
    """
    before = start_motion(motion, body, settings)
    skip = max(settings.settle - 1, 0)  # the last settled frame is where the drape stands
    rotations = np.concatenate([before.rotations[skip:], motion.rotations])
    whole = Motion(rotations, np.concatenate([before.root[skip:], motion.root]), motion.fps)
    return whole, to_world(drape, whole.root[0], float(heading(whole.rotations[:1, 0])[0]))


def to_world(state: ClothState, root: np.ndarray, yaw: float) -> ClothState:
    """Return `state` at a root position `[3]` (metres) and heading (radians), in the world."""
    turn = yaw_matrix(np.array(yaw)).T
    positions = state.positions.astype(np.float64) @ turn + root
    velocities = state.velocities.astype(np.float64) @ turn
    return ClothState(positions.astype(np.float32), velocities.astype(np.float32))
