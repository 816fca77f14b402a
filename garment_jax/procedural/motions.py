"""Motions made in code: dance figures by name, and seeded dances of them."""

from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter1d

from garment_jax.procedural.gestures import kick, sway
from garment_jax.procedural.grounding import ground
from garment_jax.procedural.pose import LIMITS, world_rotations
from garment_jax.procedural.steps import side_steps, turn, twirl, walk
from garment_jax.procedural.track import Track, ramp, standing
from garment_jax.structs import Motion, RiggedBody

_FIGURES: dict[str, Callable[[np.ndarray, np.random.Generator], Track]] = {
    "walk": walk,
    "turn": turn,
    "twirl": twirl,
    "sway": sway,
    "side_steps": side_steps,
    "kick": kick,
}
MOTIONS = tuple(_FIGURES)
EASE = 0.8  # seconds from standing into a figure, and from one figure into the next
SMOOTHING = 0.04  # seconds, of all angles: rounds the corners of the figures' curves
SHORTEST, LONGEST = 2.6, 4.6  # seconds of one figure in a dance


def make_motion(kind: str, body: RiggedBody, *, seconds: float, fps: float = 30.0, seed: int = 0) -> Motion:
    """Return one figure of `MOTIONS` for `seconds`, begun from standing at x = z = 0, facing +Z.

    The seed draws tempo, size, sides and pauses. Joint angles keep to `pose.LIMITS`, the lower sole is
    on the floor within a centimetre. The body needs the mannequin's 22 joint names. Raises `ValueError`
    for an unknown kind, a missing joint and a length or rate that makes no frames.
    """
    if kind not in _FIGURES:
        raise ValueError(f"motion {kind!r} is unknown; choose one of {', '.join(MOTIONS)}.")
    time = _times(seconds, fps)
    rng = np.random.default_rng([seed, MOTIONS.index(kind)])
    return _played(_mixed([(_FIGURES[kind](time, rng), ramp(time, 0.0, EASE))], time), body, fps)


def make_dance(body: RiggedBody, *, seconds: float, fps: float = 30.0, seed: int = 0) -> Motion:
    """Return a seeded sequence of figures for `seconds`, each blended into the next, from standing.

    No figure follows itself. Raises `ValueError` as `make_motion` does.
    """
    time = _times(seconds, fps)
    rng = np.random.default_rng([seed, len(MOTIONS)])
    start, last, parts = 0.0, "", []
    while start < seconds:
        last = str(rng.choice([kind for kind in MOTIONS if kind != last]))
        end = start + rng.uniform(SHORTEST, LONGEST)
        weight = ramp(time, start, EASE) - ramp(time, end, EASE)
        parts.append((_FIGURES[last](np.maximum(time - start, 0.0), rng), weight))
        start = end
    return _played(_mixed(parts, time), body, fps)


def _times(seconds: float, fps: float) -> np.ndarray:
    if not 1.0 <= fps <= 1000.0:
        raise ValueError(f"fps={fps} must lie between 1 and 1000; 30 is usual.")
    count = round(seconds * fps)
    if count < 2:
        raise ValueError(
            f"seconds={seconds} makes {count} frames at {fps:g} fps; give at least {2 / fps:.3g}."
        )
    return np.arange(count) / fps


def _mixed(parts: list[tuple[Track, np.ndarray]], time: np.ndarray) -> Track:
    """Return the weighted mean of tracks; what is missing to a weight of 1 is standing."""
    total = standing(time)
    rest = total.angles.copy()
    angles, turning = total.angles, total.turning
    for track, weight in parts:
        angles = angles + weight[:, None, None] * (track.angles - rest)
        turning = turning + weight * track.turning
    return Track(angles, turning)


def _played(track: Track, body: RiggedBody, fps: float) -> Motion:
    """Return the motion of a track: corners rounded, limits kept, feet on the floor."""
    angles = np.clip(track.angles, LIMITS[..., 0], LIMITS[..., 1])
    angles = gaussian_filter1d(angles, SMOOTHING * fps, axis=0, mode="nearest")
    turning = gaussian_filter1d(track.turning, SMOOTHING * fps, mode="nearest")
    yaw = np.radians(np.concatenate([[0.0], np.cumsum((turning[1:] + turning[:-1]) / 2) / fps]))
    rotations = world_rotations(angles, yaw, body)
    root = ground(rotations, body, fps)
    return Motion(rotations.astype(np.float32), root, float(fps))
