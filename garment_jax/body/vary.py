"""Variations of a motion: the same dance faster, slower, wider, turning, begun elsewhere.

A garment's answer to a motion is learnt from examples, and captured motion is scarce while simulation is
not. What is varied is what bodies vary; the result is simulated anew, so the cloth's answer is exact.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.kicks import kicked
from garment_jax.body.root_frame import yaw_matrix
from garment_jax.structs import Motion, RiggedBody

SPIN_DEGREES = 90.0, 540.0  # of one quick turn
SPIN_RATE = 250.0, 650.0  # degrees per second at its fastest: dancers spin at 400 to 600
LEGS = ("LeftUpLeg", "LeftLeg", "RightUpLeg", "RightLeg")


class Variation(NamedTuple):
    """How far a motion may be varied; each is drawn between its bounds, evenly."""

    tempo: tuple[float, float] = (0.75, 1.3)  # speed of the dance
    legs: tuple[float, float] = (0.8, 1.2)  # angle of hips and knees, as a part of their own
    turn: tuple[float, float] = (-60.0, 60.0)  # degrees per second that the whole body turns besides
    begin: tuple[float, float] = (0.0, 0.4)  # part of the motion that is left out at its beginning
    spins: tuple[float, float] = (0.0, 0.0)  # quick turns of the whole body in ten seconds, on average
    kicks: tuple[float, float] = (0.0, 0.0)  # raised legs in ten seconds, on average


def vary_motion(
    motion: Motion,
    body: RiggedBody,
    rng: np.random.Generator,
    *,
    variation: Variation = Variation(),
    legs: tuple[str, ...] = LEGS,
) -> Motion:
    """Return a variation of `motion` at the same frame rate; its length follows from tempo and beginning.

    `legs` name the joints whose angles against their parents are scaled; those that the body lacks are
    passed over. A turn swings slowly to and fro, so that it neither winds up nor stands still; spins and
    kicks come on top.
    """
    tempo, legs_scale, turn, begin = (rng.uniform(*bounds) for bounds in variation[:4])
    whole = resampled(motion, tempo)
    first = int(begin * (len(whole.root) - 2))
    part = Motion(whole.rotations[first:], whole.root[first:], motion.fps)
    part = _scaled_joints(part, body, legs, legs_scale)
    period = rng.uniform(3.0, 8.0)  # seconds of one swing to and fro
    time = np.arange(len(part.root)) / motion.fps
    angle = np.radians(turn) * period / (2 * np.pi) * np.sin(2 * np.pi * time / period)
    if variation.spins[1] > 0:  # else nothing more is drawn: the same seed gives the motion of before
        angle = angle + _spins(time, rng.uniform(*variation.spins), rng)
    part = _turned(part, angle)
    if variation.kicks[1] > 0:
        part = kicked(part, body, rng.uniform(*variation.kicks), rng)
    return part


def _spins(time: np.ndarray, in_ten_seconds: float, rng: np.random.Generator) -> np.ndarray:
    """Return the angle `[t]` (radians) of quick turns at random times, each speeding up and slowing down.

    Such turns fling a skirt out and wind it around the body; captured dances hold few. Where two fall
    together they add up.
    """
    angle = np.zeros(len(time))
    for _ in range(rng.poisson(in_ten_seconds * time[-1] / 10.0)):
        whole = np.radians(rng.uniform(*SPIN_DEGREES)) * rng.choice([-1.0, 1.0])
        lasts = np.pi / 2 * abs(whole) / np.radians(rng.uniform(*SPIN_RATE))
        begun = rng.uniform(-lasts, time[-1])
        angle += whole * 0.5 * (1 - np.cos(np.pi * np.clip((time - begun) / lasts, 0.0, 1.0)))
    return angle


def cut(motion: Motion, longest: int | None, rng: np.random.Generator) -> Motion:
    """Return `longest` consecutive frames from anywhere in the motion, or all of a shorter one."""
    frames = len(motion.root)
    if longest is None or frames <= longest:
        return motion
    first = int(rng.integers(0, frames - longest + 1))
    part = slice(first, first + longest)
    return Motion(motion.rotations[part], motion.root[part], motion.fps)


def resampled(motion: Motion, tempo: float) -> Motion:
    """Return the motion played `tempo` times as fast, at its frame rate; shortest arcs between frames."""
    frames = len(motion.root)
    at = np.arange(0.0, frames - 1 + 1e-9, tempo)
    low = np.minimum(at.astype(int), max(frames - 2, 0))
    share = at - low
    high = np.minimum(low + 1, frames - 1)
    R = motion.rotations.astype(np.float64)
    step = Rotation.from_matrix((np.swapaxes(R[low], -1, -2) @ R[high]).reshape(-1, 3, 3)).as_rotvec()
    step = step.reshape(len(at), -1, 3) * share[:, None, None]
    between = Rotation.from_rotvec(step.reshape(-1, 3)).as_matrix().reshape(len(at), -1, 3, 3)
    root = motion.root[low] * (1 - share[:, None]) + motion.root[high] * share[:, None]
    return Motion((R[low] @ between).astype(motion.rotations.dtype), root, motion.fps)


def _scaled_joints(motion: Motion, body: RiggedBody, names: tuple[str, ...], scale: float) -> Motion:
    """Return the motion with the named joints' angles against their parents scaled."""
    R = motion.rotations.astype(np.float64)
    parents = np.maximum(body.parents, 0)
    local = np.swapaxes(R[:, parents], -1, -2) @ R
    local[:, 0] = R[:, 0]
    for name in names:
        if name not in body.joint_names:
            continue
        j = body.joint_names.index(name)
        angles = Rotation.from_matrix(local[:, j]).as_rotvec() * scale
        local[:, j] = Rotation.from_rotvec(angles).as_matrix()
    for j in range(1, len(parents)):  # parents come before their children
        R[:, j] = R[:, parents[j]] @ local[:, j]
    return motion._replace(rotations=R.astype(motion.rotations.dtype))


def _turned(motion: Motion, angle: np.ndarray) -> Motion:
    """Return the motion with the body turned by `angle` `[t]` radians about the vertical through its root."""
    turn = yaw_matrix(angle)
    # the travel turns with the body, step by step: a dancer who faces elsewhere walks elsewhere
    steps = np.einsum("tab,tb->ta", turn[:-1], np.diff(motion.root, axis=0))
    root = motion.root[:1] + np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    rotations = turn[:, None] @ motion.rotations.astype(np.float64)
    return Motion(rotations.astype(motion.rotations.dtype), root, motion.fps)
