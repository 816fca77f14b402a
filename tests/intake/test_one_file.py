"""A unit or an axis that is said of a file is that of everything in it."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.cli import main
from garment_jax.data.sequence import open_sequence
from garment_jax.intake.own_files import Wardrobe, of_one_file
from garment_jax.intake.sources import Options
from garment_jax.simulation.command import motion_jobs
from tests.intake.glb_files import write_glb
from tests.intake.good_files import FRAMES, MOTION, SCENE, V, write_all
from tests.reference.files import write_obj

CENTIMETRES = 100.0


@pytest.fixture
def walker(tmp_path: Path) -> Path:
    """A body in centimetres that walks in the same file."""
    body, root = SCENE.body, MOTION.root * CENTIMETRES
    large = body._replace(
        vertices=body.vertices * np.float32(CENTIMETRES), joints=body.joints * np.float32(CENTIMETRES)
    )
    write_obj(tmp_path / "skirt.obj", SCENE.garment)
    return write_glb(tmp_path / "me.glb", large, MOTION._replace(root=root))


def path_of(root: np.ndarray) -> np.ndarray:
    return root - root[0]


def test_unit_of_the_body_is_that_of_its_motion(walker: Path) -> None:
    options = Options(garment=walker.parent / "skirt.obj", body=walker, unit={"body": "cm"})
    motion, notes = Wardrobe(options).motion(walker, fps=30.0)
    np.testing.assert_allclose(path_of(motion.root), path_of(MOTION.root), atol=2e-3)
    assert not any("scaled by" in note for note in notes)  # the file's unit was known
    (job,) = motion_jobs(
        [walker], SCENE.body, fps=30.0, body_file=walker, body_unit="cm", floor=False, say=lambda _: None
    )
    np.testing.assert_allclose(path_of(job.motion.root), path_of(MOTION.root), atol=2e-3)


def test_one_of_the_parts_speaks_for_all() -> None:
    got = of_one_file(
        Options(unit={"clip": "cm", "body": "m"}, up={"motion": "Y"}), ("clip", "motion"), Path("a")
    )
    assert got.unit == {"clip": "cm", "motion": "cm", "body": "m"}
    assert got.up == {"clip": "Y", "motion": "Y"}
    same = Options(unit={"clip": "cm", "motion": "0.01"})
    assert set(of_one_file(same, ("clip", "motion"), Path("a")).unit) == {"clip", "motion"}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (Options(unit={"clip": "cm", "motion": "m"}), "--clip-unit cm and --motion-unit m"),
        (Options(up={"clip": "Z", "motion": "Y"}), "--clip-up Z and --motion-up Y"),
    ],
)
def test_parts_that_contradict_each_other_are_refused(options: Options, said: str) -> None:
    with pytest.raises(ValueError, match=f"^walk.pkl: {said} speak of one file; leave out"):
        of_one_file(options, ("clip", "motion"), Path("walk.pkl"))


def test_axis_of_a_clip_is_that_of_its_motion(tmp_path: Path) -> None:
    write_all(tmp_path)
    words = ["import", str(tmp_path / "dress02"), "--body", str(tmp_path / "smpl.pkl")]
    words += ["--garment", str(tmp_path / "skirt/skirt.obj"), "--fit-uv", "--fps", "30"]
    for k, option in enumerate(("--clip-up", "--motion-up")):
        assert main([*words, option, "Y", "--out", str(tmp_path / f"out{k}")]) == 0
        with open_sequence(tmp_path / f"out{k}/train/dress02_1.h5") as clip:
            assert np.abs(clip.read(0, FRAMES) - V).max() < 1e-4
