"""Many clips: written whole, gone on with, screened, the same with one process as with two."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from garment_jax.data.sequence import open_sequence
from garment_jax.simulation.clips import Job, content_key, simulate_clips
from garment_jax.simulation.screening import ScreenLimits
from garment_jax.simulation.settings import ClothSettings
from garment_jax.structs import Scene
from tests.reference.scene import make_motion, make_scene

SETTINGS = ClothSettings(substeps=4, iterations=3, linear_iterations=10, settle=2, blend=2, hold=1)
LOOSE = ScreenLimits(deepest_mm=1e4, inside_percent=100.0, strain_p99_percent=1e4, hem_rise_cm=1e3)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene()


@pytest.fixture(scope="module")
def jobs(scene: Scene) -> list[Job]:
    slow = [make_motion(scene, frames, seed, fps=30.0) for frames, seed in ((6, 0), (8, 1))]
    return [Job("one", "train", slow[0]), Job("two", "test", slow[1])]


def test_clips_are_written_and_an_interrupted_call_goes_on(tmp_path: Path, scene, jobs):
    pytest.importorskip("newton")
    first = simulate_clips(scene, jobs[:1], tmp_path, SETTINGS, limits=LOOSE, progress=lambda _: None)
    before = first[0].path.stat().st_mtime_ns
    lines: list[str] = []
    both = simulate_clips(scene, jobs, tmp_path, SETTINGS, limits=LOOSE, progress=lines.append)
    assert [outcome.path for outcome in both] == [tmp_path / "train/one.h5", tmp_path / "test/two.h5"]
    assert both[0].path.stat().st_mtime_ns == before
    assert lines[0] == "1 of 2 clips are there already"
    with open_sequence(both[1].path) as sequence:
        assert sequence.frames == 8
        assert sequence.attributes["kind"] == "simulated"
        assert "substeps 4" in sequence.attributes["settings"]
        np.testing.assert_array_equal(sequence.motion.rotations, jobs[1].motion.rotations)


def test_a_clip_that_fails_the_screening_is_named_and_not_kept(tmp_path: Path, scene, jobs):
    pytest.importorskip("newton")
    strict = replace(LOOSE, strain_p99_percent=1e-6)
    lines: list[str] = []
    (outcome,) = simulate_clips(scene, jobs[:1], tmp_path, SETTINGS, limits=strict, progress=lines.append)
    assert outcome.path is None
    assert "left out: strain" in lines[-1]
    assert not list(tmp_path.rglob("*.h5"))


def test_two_processes_give_the_bits_of_one(tmp_path: Path, scene, jobs):
    pytest.importorskip("newton")
    for workers in (1, 2):
        simulate_clips(
            scene,
            jobs,
            tmp_path / str(workers),
            SETTINGS,
            limits=LOOSE,
            workers=workers,
            progress=lambda _: None,
        )
    for name in ("train/one.h5", "test/two.h5"):
        with open_sequence(tmp_path / "1" / name) as one, open_sequence(tmp_path / "2" / name) as two:
            np.testing.assert_array_equal(one.read(0, one.frames), two.read(0, two.frames))


def test_an_open_collider_is_refused_before_anything_is_simulated(tmp_path: Path, scene, jobs):
    assert scene.collider is not None
    hole = scene._replace(collider=scene.collider._replace(faces=scene.collider.faces[1:]))
    with pytest.raises(ValueError, match="close its holes"):
        simulate_clips(hole, jobs, tmp_path, SETTINGS)


def test_the_key_changes_with_everything_a_clip_depends_on(scene, jobs):
    motion = jobs[0].motion
    base = content_key(scene, motion, SETTINGS, None)
    assert content_key(scene, motion, SETTINGS, None) == base
    assert scene.pins is not None
    others = [
        content_key(scene, motion._replace(root=motion.root + 1e-3), SETTINGS, None),
        content_key(scene, motion, replace(SETTINGS, bend=1e-4), None),
        content_key(scene, motion, SETTINGS, scene.garment.uv),
        content_key(scene._replace(pins=None), motion, SETTINGS, None),
        content_key(scene._replace(collider=None), motion, SETTINGS, None),
    ]
    assert len({base, *others}) == 6
