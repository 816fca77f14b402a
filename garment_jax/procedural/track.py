"""A track: joint angles and turning speed over time, and the curves it is drawn with."""

from typing import NamedTuple

import numpy as np

from garment_jax.procedural.pose import joint
from garment_jax.procedural.skeleton import JOINT_NAMES

X, Y, Z = 0, 1, 2


class Track(NamedTuple):
    """Joint angles of every frame (see `pose`); a mixture of tracks is one too."""

    angles: np.ndarray  # [t, 22, 3] degrees
    turning: np.ndarray  # [t] degrees per second about +Y


def standing(time: np.ndarray) -> Track:
    """Return the pose that all figures start from: legs upright, arms held clear of a skirt."""
    angles = np.zeros((len(time), len(JOINT_NAMES), 3))
    for side in ("Left", "Right"):
        angles[:, joint(side + "UpLeg"), Z] = -4.0
        angles[:, joint(side + "Foot"), Z] = 4.0
        angles[:, joint(side + "Arm"), Z] = -4.0
        angles[:, joint(side + "ForeArm"), Y] = -14.0
    return Track(angles, np.zeros(len(time)))


def bend_leg(
    track: Track, side: str, hip: np.ndarray, knee: np.ndarray, pitch: np.ndarray | float = 0.0
) -> None:
    """Add a bent hip and knee (degrees, forward and back) and let the ankle keep the sole level.

    `pitch` is the sole's own tilt, toes down. The ankle yields softly before its limit.
    """
    track.angles[:, joint(side + "UpLeg"), X] -= hip
    track.angles[:, joint(side + "Leg"), X] += knee
    tilt = pitch + hip - knee - track.angles[:, joint("Hips"), X]
    track.angles[:, joint(side + "Foot"), X] += np.where(tilt > 0, 45.0, 28.0) * np.tanh(
        tilt / np.where(tilt > 0, 45.0, 28.0)
    )


def spread_leg(track: Track, side: str, away: np.ndarray) -> None:
    """Add degrees sideways to a leg, away from the other; the ankle keeps the sole level."""
    track.angles[:, joint(side + "UpLeg"), Z] += away
    track.angles[:, joint(side + "Foot"), Z] -= 20.0 * np.tanh(away / 20.0)


def bump(cycle: np.ndarray, centre: float, width: float) -> np.ndarray:
    """Return a periodic bell of height 1 around `centre`, all in parts of a cycle."""
    return np.exp((np.cos(2 * np.pi * (cycle - centre)) - 1.0) / (2 * np.pi * width) ** 2)


def ramp(time: np.ndarray, start: float, length: float) -> np.ndarray:
    """Return 0 before `start`, 1 after `start + length`, smooth between (two derivatives are 0)."""
    u = np.clip((time - start) / length, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def drift(time: np.ndarray, rng: np.random.Generator, size: float) -> np.ndarray:
    """Return slow random waves of at most `size`, different for every draw."""
    rates, phases = rng.uniform(0.05, 0.25, 3), rng.uniform(0, 2 * np.pi, 3)
    return size / 3 * np.sin(2 * np.pi * rates * time[:, None] + phases).sum(axis=1)
