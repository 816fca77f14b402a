"""Jumps in a motion: out of the rest pose that files often begin with, and anywhere (host, NumPy)."""

import numpy as np

from garment_jax.body.skeleton_track import SkeletonTrack, world_positions

PERSON = 1.6  # metres that a skeleton is taken to be high
LEADING = 15  # frames at the beginning in which a rest pose may stand
SEEN = 20 * LEADING  # frames of a motion whose speeds are found
FAST_START = 8.0  # metres per second: a jump out of a rest pose
_TIMES = 6.0  # a jump is this many times faster than the frames around it
_AROUND = 15  # frames on each side that a jump is compared with


def track_speeds(track: SkeletonTrack, rate: float) -> np.ndarray:
    """Return the fastest joint's speed from each frame to the next, metres per second `[t - 1]`.

    As of a person, whatever the track's unit; of the first `SEEN` frames.
    """
    moved = {joint: places[:SEEN] for joint, places in track.moved.items()}
    first = track._replace(rotations=track.rotations[:SEEN], root=track.root[:SEEN], moved=moved)
    points = world_positions(first)
    size = float(np.ptp(points[0], axis=0).max()) if len(points) else 0.0
    if not size > 0.0:
        return np.zeros(0)
    return np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1) * (PERSON / size * rate)


def leading_frames(speed: np.ndarray) -> int:
    """Return how many frames at the beginning belong to a rest pose and the jump out of it, 0 for none.

    `speed` `[t - 1]` in metres per second, the fastest joint's. The cut is at the last jump, whose steps are
    faster than people and than the frames around them: a motion that begins briskly after it stays whole.
    """
    begin, after = speed[:LEADING], speed[LEADING : 3 * LEADING]
    if len(after) < LEADING or begin.max() < _TIMES * np.median(after):
        return 0
    found = jump_frames(speed[: 3 * LEADING], FAST_START)
    early = found[found < LEADING]
    return int(early[-1]) + 1 if len(early) else 0


def jump_frames(speed: np.ndarray, limit: float) -> np.ndarray:
    """Return the steps faster than `limit` and than the frames around them; `speed` `[t - 1]` m/s."""
    fast = np.flatnonzero(speed > limit)
    around = [np.median(speed[max(i - _AROUND, 0) : i + _AROUND + 1]) for i in fast]
    return fast[speed[fast] > _TIMES * np.array(around)] if len(fast) else fast
