"""Motion capture files (BVH): a skeleton and its rotations and root positions, frame by frame."""

import re
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

SHORTEST, LONGEST = 1e-4, 1.0  # seconds a frame; anything else is no motion capture
_KINDS = {f"{axis}{kind}" for axis in "XYZ" for kind in ("POSITION", "ROTATION")}
_TIMING = re.compile(r"\s*Frames:\s*(\S+)\s+Frame\s+Time:\s*(\S+)[^\S\n]*(?:\n|$)", re.IGNORECASE)


class BvhClip(NamedTuple):
    """A motion capture clip in its file's units (often cm or inches) and axes (often Y up).

    In the rest pose every rotation is the identity, and joint j stands at its parent's place plus
    `offsets[j]`; so `rotations[t, j]` takes a direction of the rest pose to the world.
    """

    joint_names: tuple[str, ...]  # j names, parents before children
    parents: np.ndarray  # [j] int32, -1 for the root
    offsets: np.ndarray  # [j, 3] float64 from the parent, file units
    rotations: np.ndarray  # [t, j, 3, 3] float64 world rotation of each joint from the rest pose
    root: np.ndarray  # [t, 3] float64 world position of joint 0, file units
    frame_time: float  # seconds, as the header claims


class _Skeleton(NamedTuple):
    names: list[str]
    parents: list[int]
    offsets: list[list[float]]
    channels: list[list[str]]


def read_bvh(path: str | Path) -> BvhClip:
    """Read the BVH file `path`: one skeleton, channels in any order.

    End Sites and the position channels of joints other than the root are read over: bones keep their
    lengths. Raises `FileNotFoundError` when there is no such file, and `ValueError` when it is no BVH or is
    cut off, when a row does not fit the channels or holds NaN, and for an absurd frame time.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file; give a motion capture file (.bvh).")
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    parts = re.split(r"^\s*MOTION\s*$", text, maxsplit=1, flags=re.MULTILINE | re.IGNORECASE)
    if not text.lstrip().upper().startswith("HIERARCHY") or len(parts) < 2:
        raise ValueError(f"{path} is not a BVH file: it needs a HIERARCHY and then a MOTION section.")
    skeleton = _read_skeleton(parts[0], path)
    frame_time, values = _read_frames(parts[1], sum(map(len, skeleton.channels)), path)
    rotations, root = _pose(skeleton, values)
    parents = np.array(skeleton.parents, np.int32)
    offsets = np.array(skeleton.offsets, np.float64)
    return BvhClip(tuple(skeleton.names), parents, offsets, rotations, root, frame_time)


def _read_skeleton(head: str, path: Path) -> _Skeleton:
    words = iter(head.replace("{", " { ").replace("}", " } ").split()[1:])
    skeleton = _Skeleton([], [], [], [])
    try:
        _read_joints(words, skeleton)
        if not skeleton.names or len(set(skeleton.names)) < len(skeleton.names):
            raise ValueError("it needs joints, each with a name of its own")
        if not np.isfinite(skeleton.offsets).all():
            raise ValueError("an OFFSET is not finite")
    except (StopIteration, IndexError, ValueError) as error:
        reason = str(error) if isinstance(error, ValueError) else "its braces do not match"
        raise ValueError(f"{path}: the skeleton cannot be read: {reason}; export the file again.") from None
    return skeleton


def _read_joints(words: Iterator[str], skeleton: _Skeleton) -> None:
    open_joints: list[int] = []
    for word in words:
        match word.upper():
            case "ROOT" | "JOINT":
                if not open_joints and (skeleton.names or word.upper() == "JOINT"):
                    raise ValueError("one ROOT must hold all joints")
                skeleton.parents.append(open_joints[-1] if open_joints else -1)
                open_joints.append(len(skeleton.names))
                skeleton.names.append(" ".join(iter(words.__next__, "{")))
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
                raise ValueError(f"unexpected {word!r}")
    if open_joints:
        raise ValueError("it ends early")


def _channels(words: Iterator[str]) -> list[str]:
    names = [next(words).upper() for _ in range(int(next(words)))]
    if not _KINDS.issuperset(names) or len(set(names)) < len(names):
        raise ValueError(f"unknown or repeated channels {' '.join(names)}")
    return names


def _read_frames(body: str, channels: int, path: Path) -> tuple[float, np.ndarray]:
    """Return the frame time and the values `[t, channels]`; nothing is sized by the header's count."""
    timing = _TIMING.match(body)
    if timing is None:
        raise ValueError(f"{path}: 'Frames:' and 'Frame Time:' must follow MOTION; export the file again.")
    frames, frame_time = _timing(timing, path)
    rows = [row.split() for row in body[timing.end() :].splitlines() if row.strip()]
    if len(rows) != frames:
        raise ValueError(f"{path} announces {frames} frames and holds {len(rows)}; it is cut off or edited.")
    for t, row in enumerate(rows):
        if len(row) != channels:
            raise ValueError(
                f"{path}: frame {t} holds {len(row)} numbers for {channels} channels; "
                "it is cut off or edited."
            )
    try:
        values = np.fromiter(map(float, chain.from_iterable(rows)), np.float64, frames * channels)
    except ValueError as error:
        raise ValueError(f"{path}: the frames hold no numbers: {error}; export the file again.") from None
    values = values.reshape(frames, channels)
    if not np.isfinite(values).all():
        bad = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
        raise ValueError(f"{path}: frame {bad} holds NaN or infinity; cut that part out of the clip.")
    return frame_time, values


def _timing(found: re.Match[str], path: Path) -> tuple[int, float]:
    try:
        frames, frame_time = int(found[1]), float(found[2])
    except ValueError as error:
        raise ValueError(f"{path}: the frames' header cannot be read: {error}.") from None
    if frames < 1:
        raise ValueError(f"{path} announces {frames} frames; a clip has at least one.")
    if not SHORTEST <= frame_time <= LONGEST:
        raise ValueError(
            f"{path}: a frame time of {found[2]} s is absurd; write {SHORTEST:g} to {LONGEST:g}, "
            "0.0333333 for 30 frames a second."
        )
    return frames, frame_time


def _pose(skeleton: _Skeleton, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rotations = np.zeros((len(values), len(skeleton.names), 3, 3))
    root = np.tile(np.array(skeleton.offsets[0]), (len(values), 1))
    first = 0
    for j, channels in enumerate(skeleton.channels):
        mine = values[:, first : first + len(channels)]
        first += len(channels)
        local = _local_rotation(channels, mine)
        parent = skeleton.parents[j]
        rotations[:, j] = local if parent < 0 else rotations[:, parent] @ local
        if j == 0:
            for k, name in enumerate(channels):
                if name.endswith("POSITION"):
                    root[:, "XYZ".index(name[0])] = mine[:, k]
    return rotations, root


def _local_rotation(channels: list[str], values: np.ndarray) -> np.ndarray:
    turning = [k for k, name in enumerate(channels) if name.endswith("ROTATION")]
    if not turning:
        return np.broadcast_to(np.eye(3), (len(values), 3, 3))
    # the first channel is the outermost rotation; capitals turn about the axes that move with the joint
    order = "".join(channels[k][0] for k in turning)
    return Rotation.from_euler(order, values[:, turning], degrees=True).as_matrix()
