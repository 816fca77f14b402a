"""The motion vector M of a frame (paper 3.3; layout and departures in the method).

M = the root's tilt (6), the chosen joints' rotations relative to their parents (6 each), the root's linear
velocity (3, m/s) and yaw rate (1, rad/s), the chosen joints' velocities (3 each, m/s) and positions
(3 each, metres). Everything is in the root frame, so it does not change when the motion is moved or turned.
Departures from the paper, which gives rotations and translation: velocities replace the translation
(a model that knows where it stands does not generalise) and positions are added.
Velocities are backward differences: nothing from the future; frame 0 takes its successor's.
"""

import numpy as np

from garment_jax.body.kinematics import joint_positions
from garment_jax.body.root_frame import heading, yaw_matrix
from garment_jax.structs import Motion, RiggedBody

ALL = ("all",)  # in the place of names: every joint but the root, whose motion M holds anyway


def chosen_joints(body: RiggedBody, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return `names`, or for `ALL` the body's joints without its root (the root alone if it has no other)."""
    if tuple(names) != ALL:
        return tuple(names)
    return tuple(body.joint_names[1:]) or tuple(body.joint_names)


def joint_indices(body: RiggedBody, names: tuple[str, ...]) -> np.ndarray:
    """Return the indices of `names`; `ValueError` lists the body's joints when one is missing."""
    names = chosen_joints(body, names)
    missing = [name for name in names if name not in body.joint_names]
    if missing:
        raise ValueError(
            f"the body has no joint {missing[0]!r}; it has {', '.join(body.joint_names)}. "
            "Set body.motion_joints accordingly (all: every joint but the root)."
        )
    return np.array([body.joint_names.index(name) for name in names], int)


def backward_velocity(x: np.ndarray, fps: float) -> np.ndarray:
    """Return (x_t - x_{t-1}) fps in float64; frame 0 takes its successor's, a single frame zero."""
    step = np.zeros(x.shape, np.float64)
    step[1:] = np.diff(x.astype(np.float64), axis=0) * fps
    if len(x) > 1:
        step[0] = step[1]
    return step


def feature_names(names: tuple[str, ...]) -> list[str]:
    """Return what each number of M is, for reports of the training range."""
    out = [f"root tilt {k}" for k in range(6)]
    out += [f"{name} rotation {k}" for name in names for k in range(6)]
    out += [f"root velocity {axis} m/s" for axis in "xyz"] + ["root yaw rate rad/s"]
    out += [f"{name} velocity {axis} m/s" for name in names for axis in "xyz"]
    return out + [f"{name} position {axis} m" for name in names for axis in "xyz"]


def root_velocity_at(width: int) -> int:
    """Return where the root's velocity (3, then its yaw rate) begins in an M of this width (layout above)."""
    return 6 + 6 * ((width - 10) // 12)


def motion_features(
    motion: Motion, body: RiggedBody, names: tuple[str, ...], frames: slice | None = None
) -> np.ndarray:
    """Return M for every frame, `[t, 10 + 12 k]` float32 for `k` joint `names` (layout above; `ALL` of them).

    `frames` `start:stop`: of these frames alone, which with the one before them are all that is read.
    Computed in float64 before the cast: a velocity is a small difference of large world positions.
    """
    start, stop = (0, len(motion.root)) if frames is None else (frames.start, frames.stop)
    first = max(start - 1, 0)
    motion = Motion(motion.rotations[first:stop], motion.root[first:stop], motion.fps)
    joints = joint_indices(body, names)
    R, root = motion.rotations.astype(np.float64), motion.root.astype(np.float64)
    yaw = heading(R[:, 0])
    to_heading = yaw_matrix(-yaw)
    parents = np.maximum(body.parents[joints], 0)
    relative = np.swapaxes(R[:, parents], -1, -2) @ R[:, joints]
    positions = joint_positions(R, root, body)[:, joints]

    def turned(x: np.ndarray) -> np.ndarray:
        return np.einsum("tab,t...b->t...a", to_heading, x)

    yaw_rate = backward_velocity(np.unwrap(yaw), motion.fps)
    parts = [
        (to_heading @ R[:, 0])[..., :2],
        relative[..., :2],
        turned(backward_velocity(root, motion.fps)),
        yaw_rate[:, None],
        turned(backward_velocity(positions, motion.fps)),
        turned(positions - root[:, None]),
    ]
    M = np.concatenate([part.reshape(len(root), -1) for part in parts], axis=1).astype(np.float32)
    return M[start - first :]
