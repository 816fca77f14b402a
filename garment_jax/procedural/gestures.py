"""Figures that stay in place: sway and kick. Seeded tempo and size; degrees and seconds."""

import numpy as np
from scipy.interpolate import PchipInterpolator

from garment_jax.procedural.pose import joint
from garment_jax.procedural.track import Track, X, Y, Z, bend_leg, drift, spread_leg, standing

# Parts of a kick: wind-up, strike, return. The leg's hip and knee in degrees of a full kick.
_PARTS = np.array([0.0, 0.06, 0.16, 0.27, 0.46, 0.56, 0.72, 0.9, 1.0])
_HIP = PchipInterpolator(_PARTS, [0.0, 0.0, 6.0, -12.0, 78.0, 72.0, 38.0, 0.0, 0.0])
_KNEE = PchipInterpolator(_PARTS, [0.0, 0.0, 38.0, 56.0, 5.0, 12.0, 46.0, 0.0, 0.0])
_EFFORT = PchipInterpolator(_PARTS, [0.0, 0.1, 0.3, 0.6, 1.0, 0.95, 0.5, 0.0, 0.0])


def sway(time: np.ndarray, rng: np.random.Generator) -> Track:
    """Return hips that swing from leg to leg over standing feet; the free side's knee bends."""
    track, size = standing(time), rng.uniform(0.85, 1.15)
    phase = 2 * np.pi * rng.uniform(0.5, 0.75) * time + rng.choice([0.0, np.pi])
    s = np.sin(phase)
    tilt, shift = 7.0 * size * s, 7.0 * size * s
    track.angles[:, joint("Hips"), Z] = tilt
    track.angles[:, joint("Hips"), Y] = 6.0 * size * np.cos(phase)
    track.angles[:, joint("LowerBack"), Z] = -0.6 * tilt
    track.angles[:, joint("Spine1"), Z] = -0.5 * tilt
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        free = ((1.0 - sign * s) / 2) ** 2
        bend_leg(track, side, 3.0 + 15.0 * size * free, 6.0 + 30.0 * size * free)
        spread_leg(track, side, 5.0 - sign * shift)
        # the tilt of the pelvis is taken back above the foot, which the leg's own ankle leaves level
        track.angles[:, joint(side + "UpLeg"), Z] -= sign * tilt
        track.angles[:, joint(side + "Arm"), Z] += 8.0 + 6.0 * sign * s
        track.angles[:, joint(side + "Arm"), X] = -6.0 * sign * np.cos(phase)
    return track._replace(turning=drift(time, rng, 16.0))


def kick(time: np.ndarray, rng: np.random.Generator) -> Track:
    """Return kicks forwards, across and to the side, the legs in turn, 50 to 85 degrees high."""
    track, start, sign = standing(time), rng.uniform(0.0, 0.3), rng.choice([-1.0, 1.0])
    for side in ("Left", "Right"):
        bend_leg(track, side, np.full(len(time), 6.0), np.full(len(time), 12.0))
    while start < time[-1]:
        length, height = rng.uniform(1.7, 2.2), rng.uniform(0.65, 1.05)
        sideways = rng.choice([0.0, 12.0, 38.0])
        s = np.clip((time - start) / length, 0.0, 1.0)
        _one_kick(track, sign, s, height, sideways)
        start, sign = start + length + rng.uniform(0.0, 0.4), -sign
    return track._replace(turning=drift(time, rng, 20.0))


def _one_kick(track: Track, sign: float, s: np.ndarray, height: float, sideways: float) -> None:
    """Add one kick of the left (`sign` 1) or right leg; `s` `[t]` runs from 0 to 1 during it."""
    side, other = ("Left", "Right") if sign > 0 else ("Right", "Left")
    hip, knee, effort = _HIP(s), _KNEE(s), height * _EFFORT(s)
    bent = hip * height * (1.0 - 0.5 * sideways / 38.0)
    track.angles[:, joint(side + "UpLeg"), X] -= bent
    track.angles[:, joint(side + "Leg"), X] += knee * height
    track.angles[:, joint(side + "Foot"), X] += 24.0 * effort  # a pointed foot
    spread_leg(track, side, sideways * np.maximum(hip, 0.0) / 78.0)
    track.angles[:, joint("Hips"), X] -= 9.0 * effort
    track.angles[:, joint(other + "UpLeg"), X] += 9.0 * effort  # the standing leg stays upright
    track.angles[:, joint("Hips"), Z] += sign * 5.0 * effort
    track.angles[:, joint(other + "UpLeg"), Z] += 5.0 * effort
    track.angles[:, joint("Spine"), X] += 7.0 * effort
    track.angles[:, joint("Spine1"), Y] += sign * 6.0 * effort
    for arm in ("Left", "Right"):
        track.angles[:, joint(arm + "Arm"), Z] += 22.0 * effort
