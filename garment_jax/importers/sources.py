"""What is to be imported: the user's options, a clip that is named, and a clip that was read."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from garment_jax.structs import Motion, Scene


class Options(NamedTuple):
    """What the user says about the files; None and empty are "as the files say"."""

    garment: Path | None = None
    body: Path | None = None
    motions: tuple[Path, ...] = ()
    collider: Path | None = None
    pins: str | None = None
    unit: Mapping[str, str] = {}  # of the parts "garment", "body", "motion" and "clip"
    up: Mapping[str, str] = {}  # of the same parts
    fps: float | None = None  # of a clip whose file does not say; the rate to bring motions to
    source_fps: float | None = None  # true rate of motion files that do not say it, or lie
    joints: Path | None = None  # table of joint names
    skip: int | None = 0  # first frames of motion files to drop; None: those of a rest pose
    rest_frame: int | None = None  # frame of motion files that is their rest pose
    floor: bool = False  # lift motions so that the feet are on the floor
    unwrap: bool = False
    fit_uv: bool = False
    drop_duplicates: bool = False
    mesh: Mapping[str, str] = {}  # the mesh to take, of the parts "body", "motion" and "clip"
    skeleton: Mapping[str, str] = {}  # the skeleton to take, of the parts "body" and "motion"
    animation: str | None = None  # the one to take of motion files that hold several


class ForeignClip(NamedTuple):
    """A clip that was read: converted to metres, Y up."""

    scene: Scene
    motion: Motion
    windows: Callable[[int], Iterator[np.ndarray]] | None  # yields [k, n, 3] world metres; None: a motion
    notes: tuple[str, ...] = ()  # what was decided for the user, a sentence each


class Source(NamedTuple):
    """A clip to be read."""

    name: str
    path: Path
    files: tuple[Path, ...]  # all that the result depends on, `path` too; folders stand for their files
    read: Callable[[], ForeignClip]
