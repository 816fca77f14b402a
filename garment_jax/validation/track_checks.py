"""Does a motion move as people do? Checks on joint positions over time, of any file (host, NumPy)."""

import numpy as np

from garment_jax.importers.finding import Finding, Repair
from garment_jax.importers.jumps import jump_frames, leading_frames

STILL = 1e-5  # metres a frame: no point moved
STATIC = 1e-3  # metres over a whole clip
FAST = 20.0  # metres per second: a jump anywhere
SLOW, USUAL, TOO_FAST = 0.02, 1.6, 2.5  # metres per second, of the joints' median speed


def check_track(points: np.ndarray, fps: float | None, *, usual: float = USUAL) -> list[Finding]:
    """Return the findings on joint positions `[t, j, 3]` in metres; `fps` None where the file says none."""
    if len(points) < 2:
        return [Finding("static", "error", f"the clip has {len(points)} frame", remedy="give a motion")]
    step = np.linalg.norm(np.diff(points, axis=0), axis=2)  # [t - 1, j]
    span = float(np.ptp(points, axis=0).max())
    if span < STATIC:
        return [
            Finding(
                "static",
                "error",
                f"no joint moves more than {1000 * span:.2g} mm in {len(points)} frames",
                remedy="leave the clip out, or export it again with its animation",
            )
        ]
    largest = step.max(axis=1)
    held = held_frames(largest)
    rate = fps or 30.0
    found = [Finding("static", "ok", f"joints move up to {span:.2f} m"), _held(held, fps)]
    lead = leading_frames(largest * rate)
    found += [_rest_pose(lead, largest, rate), _jumps(largest, rate, lead, held)]
    found += _frozen(largest, rate, held)
    if fps is not None:
        moving = step[lead:] if held == 1 else step[lead:][largest[lead:] > STILL] / held
        found.append(_speed(moving * fps, fps, usual))
    return found


def held_frames(step: np.ndarray) -> int:
    """Return for how many frames each pose is held by a regular pattern, 1 where none is.

    `step` `[t - 1]` is the largest movement from frame to frame.
    """
    moving = np.flatnonzero(step > STILL)
    if len(moving) < 8:
        return 1
    gaps = np.diff(moving)
    common = int(np.median(gaps))
    return common if 2 <= common <= 8 and (gaps % common == 0).mean() > 0.95 else 1


def trailing_frames(step: np.ndarray) -> int:
    """Return how many frames at the end repeat the one before them; `step` `[t - 1]`."""
    moving = np.flatnonzero(step > STILL)
    return len(step) - 1 - int(moving[-1]) if len(moving) else 0


def _held(held: int, fps: float | None) -> Finding:
    if held == 1:
        return Finding("repeated frames", "ok", "none")
    true = "" if fps is None else f": the true rate is {fps / held:g} frames a second, not {fps:g}"
    return Finding(
        "repeated frames",
        "warning",
        f"every pose is held for {held} frames{true} (certain)",
        remedy=f"take every {held}th frame, and its rate",
    )


def _rest_pose(lead: int, step: np.ndarray, fps: float) -> Finding:
    if not lead:
        return Finding("rest pose", "ok", "none at the beginning")
    first, frames = int(step[:lead].argmax()), "frame" if lead == 1 else f"{lead} frames"
    return Finding(
        "rest pose",
        "warning",
        f"a joint moves {step[first]:.2f} m in one frame ({step[first] * fps:.0f} m/s): a rest pose, a jump "
        "out of it",
        f"frame {first} to {first + 1}",
        f"drop the first {frames} (--fix does; --skip of animate, import and simulate counts the source's)",
        Repair("first", lead),
    )


def _jumps(step: np.ndarray, fps: float, lead: int, held: int) -> Finding:
    found = jump_frames(step[lead:] * fps / held, FAST) + lead
    if not len(found):
        return Finding("jumps", "ok", f"at most {step[lead:].max():.2f} m a frame")
    worst = int(found[step[found].argmax()])
    return Finding(
        "jumps",
        "error" if step[worst] > 0.5 else "warning",
        f"a joint moves {step[worst]:.2f} m in one frame ({step[worst] * fps:.0f} m/s), {len(found)} times",
        f"frame {worst} to {worst + 1}",
        "cut the clip there, or repair the joint",
    )


def _frozen(step: np.ndarray, fps: float, held: int) -> list[Finding]:
    """Return the findings on frames in which nothing moves: at the end, and elsewhere."""
    end = trailing_frames(step)
    long = max(5, round(fps / 4)) * held
    found = []
    if end >= long:
        found.append(
            Finding(
                "frozen end",
                "warning",
                f"nothing moves in the last {end} frames",
                f"frame {len(step) - end}",
                f"cut the last {end} frames (--fix does)",
                Repair("last", end),
            )
        )
    begin, length = longest_run(step[: len(step) - end] <= STILL)
    if length >= long:
        found.append(
            Finding(
                "frozen",
                "note" if length < fps else "warning",
                f"nothing moves for {length} frames",
                f"frame {begin}",
                "cut them if the capture dropped out there",
            )
        )
    return found or [Finding("frozen", "ok", "never")]


def longest_run(still: np.ndarray) -> tuple[int, int]:
    """Return where the longest run of True in `[t]` begins and how long it is."""
    padded = np.concatenate([[False], still, [False]]).astype(np.int8)
    begin, end = np.flatnonzero(np.diff(padded) == 1), np.flatnonzero(np.diff(padded) == -1)
    if not len(begin):
        return 0, 0
    k = int((end - begin).argmax())
    return int(begin[k]), int(end[k] - begin[k])


def _speed(speed: np.ndarray, fps: float, usual: float) -> Finding:
    median = float(np.median(speed)) if len(speed) else 0.0
    said = f"the joints' median speed is {median:.2f} m/s at {fps:g} frames a second"
    if median > TOO_FAST:
        ratio = next((k for k in (2, 4, 8) if median / k < 1.2), 8)
        return Finding(
            "fps",
            "warning",
            f"{said}; dancers reach 0.2 to 1.5 (likely wrong, a rate of {fps / ratio:g} fits)",
            remedy="find the capture's true rate and set it (--fps, simulate --source-fps)",
        )
    if median > usual:
        return Finding(
            "fps",
            "note",
            f"{said}, which is fast (half the rate would be usual too: not sure)",
            remedy="check the rate against the source if it is not a fast dance",
        )
    if median < SLOW:
        return Finding(
            "fps",
            "note",
            f"{said}, which is slow (it may be slowed down or stand: not sure)",
            remedy="check the rate against the source if it is not meant to stand",
        )
    return Finding("fps", "ok", said)
