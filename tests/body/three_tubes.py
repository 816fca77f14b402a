"""A figure of three tubes, a trunk and two legs, whose rig and motions are known."""

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.structs import Motion, RiggedBody

_AROUND = 8


def tube(x: float, low: float, high: float, radius: float, rings: int) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and outward faces of an open vertical tube."""
    angle = np.arange(_AROUND) * 2 * np.pi / _AROUND
    heights = np.linspace(low, high, rings)
    ring = np.stack([x + radius * np.cos(angle), 0 * angle, radius * np.sin(angle)], axis=1)
    points = (ring[None] + heights[:, None, None] * np.array([0.0, 1.0, 0.0])).reshape(-1, 3)
    faces = []
    for r in range(rings - 1):
        for k in range(_AROUND):
            a, b = r * _AROUND + k, r * _AROUND + (k + 1) % _AROUND
            faces += [[a, a + _AROUND, b], [b, a + _AROUND, b + _AROUND]]
    return points, np.array(faces)


def figure() -> RiggedBody:
    """Return the rigged figure: joints trunk, left leg and right leg, soft weights at the hips."""
    parts = [tube(0, 0.8, 1.6, 0.2, 12), tube(0.1, 0.0, 0.85, 0.08, 12), tube(-0.1, 0.0, 0.85, 0.08, 12)]
    points = np.concatenate([p for p, _ in parts])
    first = np.cumsum([0, *(len(p) for p, _ in parts)])
    faces = np.concatenate([f + start for (_, f), start in zip(parts, first[:-1], strict=True)])
    which = np.repeat([0, 1, 2], [len(p) for p, _ in parts])
    own = np.where(which == 0, 1.0, np.clip((0.85 - points[:, 1]) / 0.2, 0.0, 1.0))
    weights = np.zeros((len(points), 3))
    weights[:, 0] = 1 - own
    weights[np.arange(len(points)), which] += own
    joints = np.array([[0, 1.0, 0], [0.1, 0.8, 0], [-0.1, 0.8, 0]])
    return RiggedBody(
        points.astype(np.float32),
        faces.astype(np.int32),
        joints.astype(np.float32),
        np.array([-1, 0, 0], np.int32),
        ("trunk", "left", "right"),
        weights.astype(np.float32),
    )


def motion(frames: int, seed: int) -> Motion:
    """Return a smooth random walk of the figure that turns all joints about all axes."""
    rng = np.random.default_rng(seed)
    time = np.arange(frames)[:, None, None] / frames * 2 * np.pi
    amplitude, phase = rng.uniform(0.3, 0.8, (3, 3)), rng.uniform(0, 2 * np.pi, (3, 3))
    turns = amplitude * np.sin(time * rng.integers(1, 4, (3, 3)) + phase)
    R = Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix().reshape(frames, 3, 3, 3)
    root = np.stack([np.linspace(0, 2, frames), np.full(frames, 1.0), np.zeros(frames)], axis=1)
    return Motion(R.astype(np.float32), root, 30.0)
