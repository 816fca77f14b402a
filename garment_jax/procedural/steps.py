"""Figures that step: walk, turn, twirl and side steps. Seeded tempo and size; degrees and seconds."""

import numpy as np

from garment_jax.procedural.pose import joint
from garment_jax.procedural.track import Track, X, Y, Z, bend_leg, bump, drift, ramp, spread_leg, standing

SIDES = (("Left", 0.0), ("Right", 0.5))


def walk(time: np.ndarray, rng: np.random.Generator) -> Track:
    """Return a walk along a winding path; hip and knee follow the curves of human gait."""
    track, size, cycle = standing(time), rng.uniform(0.85, 1.1), rng.uniform(0.8, 0.95) * time + rng.uniform()
    swing = np.cos(2 * np.pi * cycle)
    track.angles[:, joint("Hips"), Y] = -5.0 * size * swing
    track.angles[:, joint("Hips"), Z] = 3.0 * np.sin(2 * np.pi * cycle)
    track.angles[:, joint("Spine1"), Y] = 8.0 * size * swing
    for side, half in SIDES:
        c = cycle + half
        hip = size * (9.0 + 21.0 * np.cos(2 * np.pi * (c + 0.03)))
        knee = 6.0 + size * (11.0 * bump(c, 0.14, 0.07) + 50.0 * bump(c, 0.73, 0.09))
        bend_leg(track, side, hip, knee, 34.0 * bump(c, 0.63, 0.07) - 12.0 * bump(c, 0.97, 0.05))
        track.angles[:, joint(side + "ToeBase"), X] = -24.0 * bump(c, 0.57, 0.06)
        track.angles[:, joint(side + "Arm"), X] = 16.0 * size * np.cos(2 * np.pi * c)
        track.angles[:, joint(side + "Arm"), Z] += 6.0
    return track._replace(turning=drift(time, rng, 32.0))


def _march(track: Track, cycle: np.ndarray, size: np.ndarray | float) -> None:
    """Add steps on the spot: each foot is lifted once in a cycle."""
    for side, half in SIDES:
        lift = size * bump(cycle + half, 0.5, 0.11)
        bend_leg(track, side, 5.0 + 17.0 * lift, 10.0 + 34.0 * lift, 14.0 * lift)


def turn(time: np.ndarray, rng: np.random.Generator) -> Track:
    """Return turns of 80 to 190 degrees to and fro, stepping, with a pause after each."""
    track, start, sign = standing(time), rng.uniform(0.0, 0.5), rng.choice([-1.0, 1.0])
    turning, busy = np.zeros(len(time)), np.full(len(time), 0.3)
    while start < time[-1]:
        length, degrees = rng.uniform(1.1, 1.7), sign * rng.uniform(80.0, 190.0)
        u = np.clip((time - start) / length, 0.0, 1.0)
        hill = (1 - np.cos(2 * np.pi * u)) / 2
        turning, busy = turning + 2 * degrees / length * hill, np.maximum(busy, hill)
        start, sign = start + length + rng.uniform(0.2, 0.6), -sign if rng.uniform() < 0.7 else sign
    _march(track, rng.uniform(0.95, 1.2) * time, busy)
    track.angles[:, joint("Spine1"), Y] = 0.05 * turning
    track.angles[:, joint("Head"), Y] = 0.06 * turning  # the head looks where the turn goes
    _raise_arms(track, 10.0 * busy)
    return track._replace(turning=turning)


def twirl(time: np.ndarray, rng: np.random.Generator) -> Track:
    """Return spins of one to two turns at 260 to 380 degrees per second, this way and that."""
    track, start, sign = standing(time), rng.uniform(0.1, 0.5), rng.choice([-1.0, 1.0])
    turning = np.zeros(len(time))
    while start < time[-1]:
        speed, hold = rng.uniform(260.0, 380.0), rng.uniform(0.5, 1.3)
        up, down = ramp(time, start, 0.8), ramp(time, start + 0.8 + hold, 0.9)
        turning += sign * speed * (up - down)
        start, sign = start + 2.5 + hold + rng.uniform(0.3, 0.8), -sign
    busy = np.abs(turning) / 380.0
    for side, _ in SIDES:
        spread_leg(track, side, -3.0 * busy)
    _march(track, rng.uniform(1.6, 1.9) * time, 0.25 + 0.35 * busy)
    track.angles[:, joint("Hips"), Z] = -3.0 * turning / 380.0  # leans into the spin
    _raise_arms(track, 38.0 * busy)
    return track._replace(turning=turning)


def side_steps(time: np.ndarray, rng: np.random.Generator) -> Track:
    """Return steps sideways, one foot out and the other after it, two or three to a side."""
    track, length, size = standing(time), rng.uniform(0.85, 1.1), rng.uniform(0.85, 1.15)
    count, signs, sign = int(time[-1] / length) + 2, [], rng.choice([-1.0, 1.0])
    while len(signs) < count:
        signs += [sign] * int(rng.integers(2, 4))
        sign = -sign
    step = (time / length).astype(int)
    s, way = time / length - step, np.array(signs)[step]
    wide = 15.0 * size * np.sin(np.pi * s) ** 2
    first, second = (np.where(part, np.sin(2 * np.pi * s) ** 2, 0.0) for part in (s < 0.5, s >= 0.5))
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        lift = np.where(way == sign, first, second)
        bend_leg(track, side, 6.0 + 14.0 * lift, 12.0 + 28.0 * lift, 8.0 * lift)
        spread_leg(track, side, wide)
        track.angles[:, joint(side + "Arm"), Z] += 0.8 * wide
    track.angles[:, joint("Spine"), Z] = -way * 5.0 * size * np.sin(2 * np.pi * s)
    return track._replace(turning=drift(time, rng, 14.0))


def _raise_arms(track: Track, degrees: np.ndarray) -> None:
    for side, _ in SIDES:
        track.angles[:, joint(side + "Arm"), Z] += degrees
        track.angles[:, joint(side + "ForeArm"), Y] -= 0.5 * degrees
