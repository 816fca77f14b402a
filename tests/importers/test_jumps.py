"""A motion's jump out of its rest pose: where it ends, and what a reader of motions says of it."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.importers.jumps import leading_frames
from garment_jax.importers.motions import read_motion
from garment_jax.io.sequence_writer import SequenceWriter
from garment_jax.structs import Motion, Scene
from tests.reference.scene import make_motion, make_scene


def speeds(*first: float, later: float = 1.5) -> np.ndarray:
    """The fastest joint's speeds over 80 steps, m/s: `first`, then `later`."""
    return np.concatenate([first, np.full(80 - len(first), later)])


@pytest.mark.parametrize(
    ("begin", "frames"),
    [
        ((107.0, *[4.7] * 7), 1),  # brisk after the jump: stays
        ((0.0,) * 9 + (60.0,), 10),  # nine frames of rest pose
        ((107.0, 0.0, 0.0, 90.0, 5.0), 4),  # two poses before the motion
        ((60.0, 30.0, 20.0, 9.5, 7.0, 3.0), 4),  # a jump that a filter drew out
        ((4.7,) * 8, 0),
        ((7.9,), 0),  # as fast as people are
        ((0.0,) * 15 + (60.0,), 0),  # no rest pose is that long
    ],
)
def test_cut_is_at_the_last_jump(begin: tuple[float, ...], frames: int) -> None:
    assert leading_frames(speeds(*begin)) == frames


def test_fast_motion_throughout_is_no_rest_pose() -> None:
    assert leading_frames(speeds(12.0, 11.0, 12.0, later=9.0)) == 0


@pytest.mark.parametrize(("skip", "said"), [(0, "--skip 3 leaves that out"), (1, "--skip 3"), (3, "")])
def test_a_reader_says_what_to_skip(tmp_path: Path, skip: int, said: str) -> None:
    scene = make_scene()
    file = write_rest_pose_first(tmp_path / "walk.h5", scene, 3)
    notes: list[str] = []
    read_motion(file, scene.body, skip=skip, say=notes.append)
    found = [note for note in notes if "rest pose" in note]
    assert len(found) == bool(said)
    assert all(said in note for note in found)


@pytest.mark.parametrize(("rest", "said"), [(3, "3 rest-pose frames"), (1, "1 rest-pose frame")])
def test_a_reader_leaves_out_a_rest_pose(tmp_path: Path, rest: int, said: str) -> None:
    scene = make_scene()
    file = write_rest_pose_first(tmp_path / "walk.h5", scene, rest)
    notes: list[str] = []
    read = read_motion(file, scene.body, skip=None, say=notes.append)
    assert notes[0] == f"{file}: {said} left out (--skip 0 keeps them)"
    np.testing.assert_allclose(read.rotations, make_motion(scene, 60).rotations, atol=1e-5)


def write_rest_pose_first(file: Path, scene: Scene, rest: int) -> Path:
    """A motion of 60 frames behind `rest` frames of a rest pose, a metre aside."""
    motion = make_motion(scene, 60)
    eye = np.broadcast_to(np.eye(3, dtype=np.float32), (rest, *motion.rotations.shape[1:]))
    root = np.concatenate([np.repeat(motion.root[:1] + [1.0, 0.0, 0.0], rest, axis=0), motion.root])
    whole = Motion(np.concatenate([eye, motion.rotations]), root, 30.0)
    with SequenceWriter(file, scene, whole, encoding="none", attributes={"name": "walk"}):
        pass
    return file
