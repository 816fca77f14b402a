"""What a model animates, beside its parameters: garment, body, collider, pins and a sample motion.

All of it is one sequence file of kind "motion" (`docs/formats.md`): whatever reads those reads it.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from garment_jax.io.hdf5 import dataset, open_hdf5, read_all
from garment_jax.io.layout import GARMENT, cast
from garment_jax.io.sequence import Sequence, open_sequence
from garment_jax.io.sequence_writer import SequenceWriter
from garment_jax.structs import Garment, Motion, Scene

SCENE = "scene.h5"
SAMPLE_SECONDS = 10.0


class Sample(NamedTuple):
    """A scene and a motion to see it with."""

    scene: Scene
    motion: Motion
    name: str  # of the motion


def sample_of(sequence: Sequence, *, seconds: float = SAMPLE_SECONDS) -> Sample:
    """Return a clip's scene and the first `seconds` of its motion; one frame at least."""
    moves = sequence.long_motion
    frames = slice(0, max(1, round(seconds * moves.fps)))
    motion = Motion(np.asarray(moves.rotations[frames]), np.asarray(moves.root[frames]), moves.fps)
    return Sample(sequence.scene, motion, sequence.name)


def read_sample(folder: str | Path) -> Sample | None:
    """Return what the model or the run in `folder` animates; None where it says nothing of that.

    Raises `OSError` or `ValueError` in one sentence for a damaged file.
    """
    path = Path(folder) / SCENE
    if not path.is_file():
        return None
    with open_sequence(path) as sequence:
        return Sample(sequence.scene, sequence.motion, sequence.name)


def write_sample(folder: Path, sample: Sample) -> Path:
    """Write `sample` into `folder` and return the file."""
    path = folder / SCENE
    with SequenceWriter(path, sample.scene, sample.motion, encoding="none", attributes={"name": sample.name}):
        pass
    return path


def read_own_garment(folder: str | Path) -> Garment | None:
    """Return the garment alone of `read_sample`, in milliseconds; None where there is no such file."""
    path = Path(folder) / SCENE
    if not path.is_file():
        return None
    where = str(path)
    with open_hdf5(path) as file:
        return Garment(
            *(cast(field, read_all(dataset(file, field.name, where), where), where) for field in GARMENT)
        )
