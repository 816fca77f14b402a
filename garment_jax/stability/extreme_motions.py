"""Motions that no model was trained on: too fast, impossible, frozen, endless."""

import numpy as np

from garment_jax.body.looped_motion import BLEND, looped_motion
from garment_jax.body.vary import LEGS, resampled
from garment_jax.stability.subject import Subject, hardest_pose, relative_angles
from garment_jax.structs import Motion, RiggedBody

TEMPOS = (1.0, 2.0, 4.0)
IMPOSSIBLE = 30  # frames that an impossible pose is held
TELEPORT = np.array([5.0, 0.0, 0.0])  # metres in one frame
SHAKE_HZ, SHAKE_G, SHAKE_FRAMES = 3.0, 10.0, 60
FROZEN, FROZEN_FULL = 300, 10_000  # frames
LOOPED, LOOPED_FULL = 1_000, 50_000  # frames
LOOP = 200  # frames of the clip that the short form repeats


def calmest_pose(motions: tuple[tuple[str, Motion], ...], body: RiggedBody) -> Motion:
    """Return the frame with the straightest hips and knees, a motion of one frame."""
    named = [body.joint_names.index(name) for name in LEGS if name in body.joint_names]
    joints = np.array(named or range(1, len(body.joint_names)), int)
    best, pose = np.inf, motions[0][1]
    for _, motion in motions:
        angle = relative_angles(motion, body.parents, joints).max(axis=1)
        t = int(angle.argmin())
        if angle[t] < best:
            best, pose = (
                float(angle[t]),
                Motion(motion.rotations[t : t + 1], motion.root[t : t + 1], motion.fps),
            )
    return pose


def extreme_motions(subject: Subject, calm: Motion, joints: tuple[str, ...]) -> list[tuple[str, Motion]]:
    """Return the motions by name, all at the subject's frame rate; `joints` are those turned by 180°.

    Joints of the right side are left out where the left one's are there: the same again.
    """
    body, parts = subject.scene.body, []
    for name, motion in subject.motions:
        parts += [(f"{name} at {tempo:g}x", resampled(motion, tempo)) for tempo in TEMPOS]
    for joint in joints:
        if joint.startswith("Right") and joint.replace("Right", "Left") in joints:
            continue
        parts.append((f"{joint} turned 180° in a frame", _turned(calm, body, joint)))
    parts.append(("body turned 180° in a frame", _about_face(calm)))
    parts.append(("root teleported 5 m in a frame", _teleported(calm)))
    parts.append(("10 g from side to side, 3 Hz", _shaken(calm)))
    frames = FROZEN_FULL if subject.full else FROZEN
    parts.append((f"frozen pose, {frames} frames", _held(hardest_pose(subject)[1], frames)))
    name, _, dance = looped(subject)
    parts.append((f"looped {name}, {len(dance.root)} frames", dance))
    return parts


def looped(subject: Subject) -> tuple[str, int, Motion]:
    """Return name, period in frames and motion of the longest clip, repeated."""
    name, clip = max(subject.motions, key=lambda item: len(item[1].root))
    if not subject.full:
        clip = Motion(clip.rotations[:LOOP], clip.root[:LOOP], clip.fps)
    frames = LOOPED_FULL if subject.full else LOOPED
    return name, len(clip.root) - BLEND, looped_motion(clip, frames)


def _held(pose: Motion, frames: int) -> Motion:
    return Motion(np.repeat(pose.rotations, frames, 0), np.repeat(pose.root, frames, 0), pose.fps)


def _turned(calm: Motion, body: RiggedBody, joint: str) -> Motion:
    """Return a joint and all below it turned half around the body's left-right axis, at once."""
    below = [body.joint_names.index(joint)]
    for j, parent in enumerate(body.parents.tolist()):
        if parent in below:
            below.append(j)
    held = _held(calm, IMPOSSIBLE)
    R = held.rotations.astype(np.float64)
    R[:, below] = R[:, below] @ np.diag([1.0, -1.0, -1.0])
    return held._replace(rotations=R)


def _about_face(calm: Motion) -> Motion:
    """Return the pose, then the pose facing the other way."""
    held = _held(calm, 2 * IMPOSSIBLE)
    R = held.rotations.astype(np.float64)
    R[IMPOSSIBLE:] = np.diag([-1.0, 1.0, -1.0]) @ R[IMPOSSIBLE:]
    return held._replace(rotations=R)


def _teleported(calm: Motion) -> Motion:
    """Return the pose, then the pose somewhere else."""
    held = _held(calm, 2 * IMPOSSIBLE)
    root = held.root.astype(np.float64)
    root[IMPOSSIBLE:] += TELEPORT
    return held._replace(root=root)


def _shaken(calm: Motion) -> Motion:
    """Return the pose shaken sideways; its second differences reach `SHAKE_G` times gravity."""
    held = _held(calm, SHAKE_FRAMES)
    turn = 2 * np.pi * SHAKE_HZ / calm.fps  # a frame
    size = SHAKE_G * 9.81 / (2 * np.sin(turn / 2) * calm.fps) ** 2
    root = held.root.astype(np.float64)
    root[:, 0] += size * (np.cos(turn * np.arange(SHAKE_FRAMES)) - 1.0)
    return held._replace(root=root)
