"""Frame rates: what a file states, what the user states, and which of them counts, decided here alone.

Files round: 0.0333 s a frame is written and 30 frames a second are meant, and a long clip must not lose a
frame over the difference. Files are silent, or number their frames where seconds belong: then they state no
rate, and the user does.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

SLOWEST, FASTEST = 1.0, 1e4  # frames a second
SAME_RATE = 5e-4  # relative difference of rates that one motion may have: nothing is resampled for it
_ONE_RATE = 2e-3  # of rates that people say for one another: 24 and 23.976, 30 and 29.97
RATE_KEYS = ("mocap_framerate", "mocap_frame_rate", "framerate", "frame_rate", "mocap_fps", "fps")
_WHOLE = (24, 25, 30, 48, 50, 60, 72, 75, 90, 96, 100, 120, 144, 150, 200, 240, 250, 300, 480, 500, 1000)
_TELEVISION = (24_000 / 1001, 30_000 / 1001, 60_000 / 1001, 120_000 / 1001)
_ROUNDED = 0.025  # relative difference beyond which a rate is not one that was rounded
_EXACT = 1e-5  # relative difference of a rate from a whole number that is that number
_MANY = 8  # whole numbers in a row are numbers of frames
_EVEN = 0.01  # part of a step by which times may be off it and be evenly spaced


def same_rate(a: float, b: float) -> bool:
    """Return whether two rates that people state are one."""
    return abs(a / b - 1) <= _ONE_RATE


def rate_of_frame_time(seconds: float) -> float:
    """Return the frames a second that `seconds` a frame mean, as far as they are rounded in decimals.

    0.0333, 0.033333 and 0.03333333 are 30; 0.00833 and 0.008333 are 120; 0.0417 is 24, 0.041708 is 23.976.
    """
    rate = 1.0 / seconds
    if abs(rate - round(rate)) <= _EXACT * rate:
        return float(round(rate))
    decimals = f"{seconds:.12f}".rstrip("0").partition(".")[2]
    unit = 10.0 ** -len(decimals)  # half of it by rounding, all of it where digits were cut off
    for meant in (*_WHOLE, round(rate), *_TELEVISION):
        if abs(rate / meant - 1) < _ROUNDED and -0.51 * unit <= 1.0 / meant - seconds < unit:
            return float(meant)
    return rate


def rate_of_times(times: np.ndarray, *, unit: float = 1.0) -> float | None:
    """Return the frames a second of evenly spaced `times` `[t]`, `unit` seconds each; None where unknown.

    That is for one frame, uneven times and times that count frames (0, 1, 2, …): nothing moves at one frame
    a second. `unit`'s and float32's rounding are allowed.
    """
    if len(times) < 2 or not np.isfinite(times).all() or times[-1] <= times[0]:
        return None
    step = float(times[-1] - times[0]) / (len(times) - 1)
    rounding = 2**-23 * float(np.abs(times).max())
    if np.abs(times - (times[0] + step * np.arange(len(times)))).max() > _EVEN * step + rounding:
        return None
    rate, whole = 1.0 / (step * unit), round(1.0 / (step * unit))
    if abs(rate - whole) <= rate * max(_EXACT, 2 * rounding / float(times[-1] - times[0])):
        rate = float(whole)
    return stated_rate(rate)


def counts_frames(times: np.ndarray) -> bool:
    """Return whether ascending `times` `[t]`, said to be seconds, are numbers of frames: whole, and many."""
    if len(times) < _MANY or not np.isfinite(times).all():
        return False
    return bool(np.abs(times - np.rint(times)).max() < 1e-3 and np.diff(times).min() > 0.5)


def stated_rate(rate: float | None) -> float | None:
    """Return a rate that a file states, None for none: not finite, too slow to move, or frame numbers."""
    if rate is None or not np.isfinite(rate) or not SLOWEST < rate <= FASTEST:
        return None
    return float(rate)


def rate_in(content: Mapping[str, Any], path: Path) -> float | None:
    """Return the rate that named arrays or values state, by any of `RATE_KEYS`; None where none is there.

    Raises `ValueError` for a value that is no rate.
    """
    name = next((name for name in RATE_KEYS if content.get(name) is not None), None)
    return None if name is None else check_rate(content[name], name, path)


def check_rate(rate: Any, name: str, path: Path) -> float:
    """Return a rate in frames a second; `ValueError` for what is none."""
    value = np.asarray(rate) if isinstance(rate, np.ndarray | np.generic | int | float) else np.array("")
    number = value.size == 1 and value.dtype.kind in "fiu"
    if not number or not SLOWEST <= float(value.reshape(())) <= FASTEST:
        shown = str(rate)[:40] if value.size == 1 else f"of shape {value.shape}"
        raise ValueError(f"{path}: {name!r} is {shown}, not 1 to 10000 frames a second; store its true rate.")
    return float(value.reshape(()))


def clip_rate(
    stated: float | None, given: float | None, path: Path, *, frames_a_sample: float = 1.0
) -> float | None:
    """Return a clip's rate: what its file states, else what the user gives (--fps); None: its motion's.

    `frames_a_sample`: the file counts samples by the frames of a scene, whose rate `given` then is. Raises
    `ValueError` where file and user contradict each other, and for samples by frames of an unknown rate.
    """
    if stated is not None and given is not None and not same_rate(stated, given):
        raise ValueError(
            f"{path} says {stated:g} fps and --fps {given:g}; cloth is not resampled: leave --fps out, or "
            "correct the rate in the file."
        )
    if stated is not None or frames_a_sample == 1.0:
        return stated if given is None else given
    if given is None:
        raise ValueError(
            f"{path} says {frames_a_sample:g} frames of its scene a sample, and not the scene's rate; give "
            "the scene's with --fps, for example 30."
        )
    return check_rate(rate_of_frame_time(frames_a_sample / given), "its rate by --fps", path)


def body_rate(
    stated: float | None,
    path: Path,
    *,
    clip: float | None,
    scene_fps: float | None = None,
    source_fps: float | None = None,
    frames_a_sample: float = 1.0,
) -> float:
    """Return the rate of a body that moves as vertices do, which nothing resamples: its cloth's (`clip`).

    `source_fps` counts before what its file says, `scene_fps` (--fps) where that says nothing. Raises
    `ValueError` where body and cloth differ, and where nobody knows.
    """
    given = None if scene_fps is None else rate_of_frame_time(frames_a_sample / scene_fps)
    own = source_fps or stated or (given if frames_a_sample != 1.0 else None)
    if own is not None and clip is not None and not same_rate(own, clip):
        raise ValueError(
            f"{path} has {own:g} fps and its cloth {clip:g}; a mesh is not resampled: export both at one "
            "rate, or give the body's true rate with --source-fps."
        )
    rate = clip or own or given
    if rate is None:
        raise ValueError(f"{path} has no frame rate, and its cloth neither; give it with --fps.")
    return check_rate(rate, "its rate", path)


def shared_rate(
    stated: float | None, fps: float | None, source_fps: float | None, path: Path, *, usual: float | None
) -> float | None:
    """Return the one rate of a file that holds cloth and its motion; None where nobody knows it.

    `stated` is what the file says, `usual` what its format always has; `source_fps` replaces both, for files
    that lie. Raises `ValueError` where two of them contradict each other.
    """
    if fps is not None and source_fps is not None and not same_rate(fps, source_fps):
        raise ValueError(
            f"{path}: --fps {fps:g} and --source-fps {source_fps:g} are two rates for a file that holds "
            "cloth and motion, which have one; give one of them."
        )
    if source_fps is not None:
        return source_fps
    if stated is not None and fps is not None and not same_rate(stated, fps):
        raise ValueError(
            f"{path} says {stated:g} fps and --fps {fps:g}; cloth is not resampled: leave --fps out, or give "
            "its true rate with --source-fps if the file is wrong."
        )
    return fps or stated or usual


def check_lengths(
    frames: int, moves: int, fps: float, path: Path, motion_path: Path, *, stated: bool = False
) -> None:
    """Raise `ValueError` unless a clip has as many `frames` as its motion at `fps`.

    `stated`: the clip's file says that rate, so that only the motion's can be another.
    """
    if frames == moves:
        return
    if path == motion_path:
        raise ValueError(
            f"{path}: its cloth has {frames} frames and its motion {moves}; export both over the same frames."
        )
    rates = "the motion's true rate with --source-fps"
    if not stated:
        rates = "the clip's true rate with --fps, the motion's with --source-fps"
    its = "its " if stated else ""
    raise ValueError(
        f"{path} has {frames} frames and {motion_path} {moves} at {its}{fps:g} fps; export both from the "
        f"same first frame to the same last, or give {rates}."
    )
