"""A motion on the skeleton of its own file: what every format becomes before it is put on a body."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np


class SkeletonTrack(NamedTuple):
    """A motion in its file's unit and axes.

    In the rest pose every rotation is the identity, and joint j stands at its parent's place plus
    `offsets[j]`; so `rotations[t, j]` takes a direction of the rest pose to the world.
    """

    joint_names: tuple[str, ...]  # j names, parents before children
    parents: np.ndarray  # [j] int32, -1 for the root
    offsets: np.ndarray  # [j, 3] float64 from the parent, file units
    rotations: np.ndarray  # [t, j, 3, 3] world rotation of each joint from the rest pose
    root: np.ndarray  # [t, 3] float64 world position of joint 0, file units
    frame_time: float  # seconds, as the header claims; NaN where the file does not say
    moved: Mapping[int, np.ndarray] = MappingProxyType(
        {}
    )  # joint -> [t, 3] its offset frame by frame, where bones carry it
    rest_is_another_world: bool = False  # the rest pose's axes are those of a model, whatever the world's are
    notes: tuple[str, ...] = ()  # what the reader decided, a phrase each


def rest_positions(track: SkeletonTrack) -> np.ndarray:
    """Return where the joints stand at rest `[j, 3]`, joint 0 at the origin; file units."""
    rest = np.zeros(track.offsets.shape)
    for j, parent in enumerate(track.parents):
        rest[j] = track.offsets[j] + rest[parent] if parent >= 0 else 0.0
    return rest


def world_positions(track: SkeletonTrack) -> np.ndarray:
    """Return where the joints are `[t, j, 3]`, world, float64, file units."""
    points = np.zeros((len(track.root), len(track.parents), 3))
    points[:, 0] = track.root
    for j in range(1, len(track.parents)):
        parent = int(track.parents[j])
        R = track.rotations[:, parent].astype(np.float64)
        offset = track.moved[j] if j in track.moved else track.offsets[j][None]
        points[:, j] = points[:, parent] + np.einsum("tij,tj->ti", R, np.broadcast_to(offset, (len(R), 3)))
    return points
