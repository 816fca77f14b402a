"""Motion capture files (BVH): a skeleton and its rotations and root positions, frame by frame."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.joint_names import roles_of
from garment_jax.body.skeleton_track import SkeletonTrack
from garment_jax.storage.missing import not_a_file

SHORTEST, LONGEST = 1e-4, 1.0  # seconds a frame; anything else is no motion capture
LARGEST = 256 * 2**20  # bytes of a file: an hour of motion capture
_LONGEST_LINE = 4 * 2**20  # bytes; a frame of 10,000 joints has 0.4 million
_MOST_JOINTS = 10_000
_POSED = 2**31  # bytes of rotations and positions; 96 a joint and frame
_DENSEST, _HARMLESS = 100, 64 * 2**20  # of them, per byte of the file, where they are many
_KINDS = {f"{axis}{kind}" for axis in "XYZ" for kind in ("POSITION", "ROTATION")}
_LONGEST_NAME = 200  # characters
_DIGITS = 18  # of a whole number; Python refuses to read what is much longer


class _Skeleton(NamedTuple):
    names: list[str]
    parents: list[int]
    offsets: list[list[float]]
    channels: list[list[str]]


def read_bvh(path: str | Path, *, root: str | None = None) -> SkeletonTrack:
    """Read the BVH file `path`: one skeleton, channels in any order.

    The position channels of the joints from ROOT down to the hips (`root`; by its name without it) move them,
    and those of joints whose OFFSET is 0 are their offsets; others are read over: bones keep their lengths.
    End Sites are read over, and rows beyond those announced, which a note says. Raises `FileNotFoundError`
    when there is no such file, and `ValueError` when it is no BVH or is cut off, when a row does not fit the
    channels or holds NaN, for an absurd frame time, and for what would fill the memory.
    """
    path = Path(path)
    if not path.is_file():
        raise not_a_file(path, "give a motion capture file (.bvh)")
    size = path.stat().st_size
    if size > LARGEST:
        raise ValueError(
            f"{path} has {size >> 20} MB, more than the {LARGEST >> 20} that are read; cut it into clips."
        )
    lines = _lines(path)
    skeleton = _read_skeleton(lines, path)
    announced, frame_time = _read_timing(lines, path)
    channels = sum(map(len, skeleton.channels))
    found = _check_rows(lines, announced, channels, path)
    needed = 96 * len(skeleton.names) * announced
    if needed > _POSED or needed > max(_HARMLESS, _DENSEST * size):
        raise ValueError(
            f"{path}: {len(skeleton.names)} joints over {announced} frames would fill {needed >> 20} MB "
            f"from a file of {size / 2**20:.4g}; it is damaged, or cut it into clips."
        )
    values = _read_rows(path, announced, channels)
    extra = found - announced
    notes = (f"{extra} rows more than the {announced} frames announced are left out",) if extra else ()
    return _pose(skeleton, values, root)._replace(frame_time=frame_time, notes=notes)


def _lines(path: Path) -> Iterator[str]:
    """Yield the file's lines that hold anything, one in memory at a time; endings of any system."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        while line := file.readline(_LONGEST_LINE):
            if len(line) == _LONGEST_LINE:
                raise ValueError(f"{path}: a line has more than {_LONGEST_LINE} characters; it is damaged.")
            if line.strip():
                yield line


def _read_skeleton(lines: Iterator[str], path: Path) -> _Skeleton:
    first = next(lines, "").split(maxsplit=1)
    if not first or first[0].upper() != "HIERARCHY":
        raise _no_bvh(path)
    skeleton = _Skeleton([], [], [], [])
    try:
        _read_joints(_words_of(first[1:], lines), skeleton)
        if not skeleton.names or len(set(skeleton.names)) < len(skeleton.names):
            raise ValueError("it needs joints, each with a name of its own")
        if not np.isfinite(skeleton.offsets).all():
            raise ValueError("an OFFSET is not finite")
    except _NoMotion:
        raise _no_bvh(path) from None
    except (StopIteration, RuntimeError, IndexError, ValueError) as error:
        reason = str(error)[:200] if isinstance(error, ValueError) else "its braces do not match"
        raise ValueError(f"{path}: the skeleton cannot be read: {reason}; export the file again.") from None
    return skeleton


class _NoMotion(Exception):
    """The file ends before its MOTION section."""


def _no_bvh(path: Path) -> ValueError:
    return ValueError(f"{path} is not a BVH file: it needs a HIERARCHY and then a MOTION section.")


def _words_of(first: list[str], lines: Iterator[str]) -> Iterator[str]:
    """Yield the hierarchy's words up to the line MOTION, which is taken."""
    yield from first
    for line in lines:
        if line.strip().upper() == "MOTION":
            return
        yield from line.replace("{", " { ").replace("}", " } ").split()
    raise _NoMotion


def _read_joints(words: Iterator[str], skeleton: _Skeleton) -> None:
    open_joints: list[int] = []
    for word in words:
        match word.upper():
            case "ROOT" | "JOINT":
                if not open_joints and (skeleton.names or word.upper() == "JOINT"):
                    raise ValueError("one ROOT must hold all joints")
                if len(skeleton.names) == _MOST_JOINTS:
                    raise ValueError(f"it has more than {_MOST_JOINTS} joints")
                skeleton.parents.append(open_joints[-1] if open_joints else -1)
                open_joints.append(len(skeleton.names))
                skeleton.names.append(_name(words))
                skeleton.offsets.append([0.0, 0.0, 0.0])
                skeleton.channels.append([])
            case "END":
                while next(words) != "}":
                    pass
            case "OFFSET":
                skeleton.offsets[open_joints[-1]] = [float(next(words)) for _ in range(3)]
            case "CHANNELS":
                skeleton.channels[open_joints[-1]] = _channels(words)
            case "}":
                open_joints.pop()
            case _:
                raise ValueError(f"unexpected {word[:40]!r}")
    if open_joints:
        raise ValueError("it ends early")


def _name(words: Iterator[str]) -> str:
    found = []
    while (word := next(words)) != "{":
        found.append(word[:_LONGEST_NAME])
        if len(found) > 20 or sum(map(len, found)) > _LONGEST_NAME:
            raise ValueError(f"joint {' '.join(found)[:40]!r}… has no brace")
    return " ".join(found)


def _channels(words: Iterator[str]) -> list[str]:
    count = _whole(next(words))
    if count > len(_KINDS):
        raise ValueError(f"{count} channels at a joint")
    names = [next(words).upper() for _ in range(count)]
    if not _KINDS.issuperset(names) or len(set(names)) < len(names):
        raise ValueError(f"unknown or repeated channels {' '.join(names)}")
    return names


def _whole(word: str) -> int:
    if len(word) > _DIGITS:
        raise ValueError(f"{word[:_DIGITS]}… is no number of anything")
    return int(word)


def _read_timing(lines: Iterator[str], path: Path) -> tuple[int, float]:
    """Return the number of frames and the frame time, which the file says after MOTION."""
    words: list[str] = []
    for line in lines:
        words += line.replace(":", ": ").split()
        if len(words) >= 5:
            break
    if len(words) != 5 or [word.upper() for word in words[:1] + words[2:4]] != ["FRAMES:", "FRAME", "TIME:"]:
        raise ValueError(f"{path}: 'Frames:' and 'Frame Time:' must follow MOTION; export the file again.")
    try:
        frames, frame_time = _whole(words[1]), float(words[4])
    except ValueError as error:
        raise ValueError(f"{path}: the frames' header cannot be read: {error}.") from None
    if frames < 1:
        raise ValueError(f"{path} announces {frames} frames; a clip has at least one.")
    if not SHORTEST <= frame_time <= LONGEST:
        raise ValueError(
            f"{path}: a frame time of {words[4]} s is absurd; write {SHORTEST:g} to {LONGEST:g}, "
            "0.0333333 for 30 frames a second."
        )
    return frames, frame_time


def _check_rows(lines: Iterator[str], frames: int, channels: int, path: Path) -> int:
    """Return the number of rows, of which the first `frames` are what they should be.

    Nothing is sized by the header's count, and no row is kept.
    """
    faults, rows = [], 0
    for rows, line in enumerate(lines, 1):
        if rows <= frames and not faults:
            faults += _fault(line.split(), rows - 1, channels, path)
    if rows < frames:
        raise ValueError(f"{path} announces {frames} frames and holds {rows}; it is cut off or edited.")
    if faults:
        raise ValueError(faults[0])
    return rows


def _fault(row: list[str], t: int, channels: int, path: Path) -> list[str]:
    if len(row) != channels:
        return [
            f"{path}: frame {t} holds {len(row)} numbers for {channels} channels; it is cut off or edited."
        ]
    try:
        finite = bool(np.isfinite(np.fromiter(map(float, row), np.float64, channels)).all())
    except ValueError as error:
        return [f"{path}: the frames hold no numbers: {str(error)[:80]}; export the file again."]
    return [] if finite else [f"{path}: frame {t} holds NaN or infinity; cut that part out of the clip."]


def _read_rows(path: Path, frames: int, channels: int) -> np.ndarray:
    """Return the values `[frames, channels]` of rows that were checked."""
    values = np.empty((frames, channels))
    lines = _lines(path)
    while next(lines).strip().upper() != "MOTION":
        pass
    words = 0
    while words < 5:  # Frames: COUNT Frame Time: SECONDS, in one line or two
        words += len(next(lines).replace(":", ": ").split())
    for t, line in zip(range(frames), lines, strict=False):
        values[t] = np.fromiter(map(float, line.split()), np.float64, channels)
    return values


def _pose(skeleton: _Skeleton, values: np.ndarray, root: str | None) -> SkeletonTrack:
    """Return the world rotations, and the offsets of the joints that their channels place."""
    parents, offsets = np.array(skeleton.parents, np.int32), np.array(skeleton.offsets, np.float64)
    rotations = np.zeros((len(values), len(skeleton.names), 3, 3))
    placing = _placing(skeleton, parents, root)
    moved, first = {}, 0
    for j, channels in enumerate(skeleton.channels):
        mine = values[:, first : first + len(channels)]
        first += len(channels)
        local = _local_rotation(channels, mine)
        parent = skeleton.parents[j]
        rotations[:, j] = local if parent < 0 else rotations[:, parent] @ local
        places = [k for k, name in enumerate(channels) if name.endswith("POSITION")]
        if not places or not (j == 0 or j in placing or not offsets[j].any()):
            continue
        if j and not mine[:, places].any():  # nothing is said: the bone has its OFFSET
            continue
        moved[j] = np.tile(offsets[j], (len(values), 1))
        moved[j][:, ["XYZ".index(channels[k][0]) for k in places]] = mine[:, places]
        if j and not offsets[j].any():
            offsets[j] = np.median(moved[j], axis=0)
    start = moved.pop(0, np.tile(offsets[0], (len(values), 1)))
    return SkeletonTrack(tuple(skeleton.names), parents, offsets, rotations, start, np.nan, moved)


def _placing(skeleton: _Skeleton, parents: np.ndarray, root: str | None) -> set[int]:
    """Return the joints from ROOT to the hips: those of that name, else to its fork."""
    if root is not None and root in skeleton.names:
        hips = skeleton.names.index(root)
    else:
        forks = np.flatnonzero(np.bincount(parents[1:], minlength=len(parents)) > 1)
        hips = roles_of(skeleton.names, parents).get("Hips", int(forks[0]) if len(forks) else 0)
    chain = set()
    while hips >= 0:
        chain.add(hips)
        hips = int(parents[hips])
    return chain


def _local_rotation(channels: list[str], values: np.ndarray) -> np.ndarray:
    turning = [k for k, name in enumerate(channels) if name.endswith("ROTATION")]
    if not turning:
        return np.broadcast_to(np.eye(3), (len(values), 3, 3))
    # the first channel is the outermost rotation; capitals turn about the axes that move with the joint
    order = "".join(channels[k][0] for k in turning)
    return Rotation.from_euler(order, values[:, turning], degrees=True).as_matrix()
