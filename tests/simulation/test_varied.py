"""Clips made of clips: varied and crossed, seeded, named, refused by file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from garment_jax.body.root_frame import heading
from garment_jax.simulation.clips import ENGINE
from garment_jax.simulation.settings import ClothSettings
from garment_jax.simulation.varied import varied_jobs
from tests.reference.scene import make_motion, make_scene, write_clip


def test_varied_clips_are_seeded_and_named_after_theirs(tmp_path: Path):
    for name, seed in (("polka", 1), ("waltz", 2)):
        write_clip(tmp_path / f"{name}.h5", 40, seed, attributes={"name": name})
    scene, jobs = varied_jobs([tmp_path], copies=2, seed=0)
    assert [job.name for job in jobs] == ["polka_v1", "polka_v2", "waltz_v1", "waltz_v2"]
    assert {job.split for job in jobs} == {"train"}
    assert len(scene.body.joint_names) == 22
    again = varied_jobs([tmp_path / "waltz.h5"], copies=1, seed=0)[1][0].motion
    np.testing.assert_array_equal(jobs[2].motion.rotations, again.rotations)
    other = varied_jobs([tmp_path / "waltz.h5"], copies=1, seed=1)[1][0].motion
    assert len(other.root) != len(again.root) or np.abs(other.root - again.root).max() > 1e-3


def test_spins_reach_variations_and_crossed_motions(tmp_path: Path):
    for name, seed in (("polka", 1), ("waltz", 2), ("jig", 3)):
        write_clip(tmp_path / f"{name}.h5", 90, seed, attributes={"name": name})
    calm, spun = (varied_jobs([tmp_path], copies=1, crosses=1, seed=5, spins=k)[1] for k in (0.0, 40.0))
    for before, after in zip(calm[:3], spun[:3], strict=True):
        assert np.abs(before.motion.rotations[:, 0] - after.motion.rotations[:, 0]).max() > 0.1
    crossed = [job.motion.rotations.astype(np.float64) for job in (calm[3], spun[3])]
    frames = min(map(len, crossed))
    assert np.abs(heading(crossed[0][:frames, 0]) - heading(crossed[1][:frames, 0])).max() > 0.1


def test_kicks_reach_variations_and_crossed_motions(tmp_path: Path):
    for name, seed in (("polka", 1), ("waltz", 2), ("jig", 3)):
        write_clip(tmp_path / f"{name}.h5", 90, seed, attributes={"name": name})
    calm, kicks = (varied_jobs([tmp_path], copies=1, crosses=1, seed=5, kicks=k)[1] for k in (0.0, 40.0))
    for before, after in zip(calm[:3], kicks[:3], strict=True):
        assert np.abs(before.motion.rotations - after.motion.rotations).max() > 0.1
        np.testing.assert_allclose(before.motion.root, after.motion.root, atol=1e-9)
    frames = min(len(jobs[3].motion.root) for jobs in (calm, kicks))
    crossed = [jobs[3].motion.rotations[:frames] for jobs in (calm, kicks)]
    assert np.abs(crossed[0] - crossed[1]).max() > 0.1


def test_clips_of_two_scenes_are_not_varied_together(tmp_path: Path):
    write_clip(tmp_path / "a.h5", 12)
    write_clip(tmp_path / "b.h5", 12, scene=make_scene(6, 12))
    with pytest.raises(ValueError, match=r"b\.h5 has another garment or body than .*a\.h5; vary them"):
        varied_jobs([tmp_path], copies=1, seed=0)
    empty = tmp_path / "none"
    empty.mkdir()
    with pytest.raises(FileNotFoundError, match="holds no clips"):
        varied_jobs([empty], copies=1, seed=0)


def test_varied_clips_in_centimetres_or_with_a_jump_are_refused_by_file(tmp_path: Path):
    scene = make_scene()
    large = scene.body._replace(vertices=scene.body.vertices * np.float32(100))
    write_clip(tmp_path / "cm.h5", 4, scene=scene._replace(body=large), encoding="float32")
    with pytest.raises(ValueError, match=r"cm\.h5: the body is 13\d m large, which looks like centimetres"):
        varied_jobs([tmp_path / "cm.h5"], copies=1, seed=0)
    motion = make_motion(scene, 12)
    jump = motion.root + np.where(np.arange(12)[:, None] >= 7, 2.0, 0.0)
    write_clip(tmp_path / "jump.h5", motion=motion._replace(root=jump))
    with pytest.raises(ValueError, match=r"jump\.h5: the root moves at [\d.]+ m/s in frame 7"):
        varied_jobs([tmp_path / "jump.h5"], copies=1, seed=0)


def test_crossed_motions_follow_the_variations_and_are_seeded(tmp_path: Path):
    for name, seed in (("polka", 1), ("waltz", 2), ("jig", 3)):
        write_clip(tmp_path / f"{name}.h5", 40, seed, attributes={"name": name})
    jobs = varied_jobs([tmp_path], copies=1, crosses=2, seed=5)[1]
    assert [job.name for job in jobs[3:]] == ["cross_5_000", "cross_5_001"]
    again = varied_jobs([tmp_path], copies=0, crosses=1, seed=5)[1]
    np.testing.assert_array_equal(again[0].motion.rotations, jobs[3].motion.rotations)
    shared = min(len(jobs[3].motion.root), len(jobs[4].motion.root))
    assert np.abs(jobs[3].motion.rotations[:shared] - jobs[4].motion.rotations[:shared]).max() > 1e-3


def test_nothing_to_make_and_too_few_to_cross_are_refused(tmp_path: Path):
    write_clip(tmp_path / "waltz.h5", 12)
    with pytest.raises(ValueError, match="--copies 0 and --crosses 0 make no clips"):
        varied_jobs([tmp_path], copies=0, seed=0)
    with pytest.raises(ValueError, match="--crosses 1 needs three clips at least and 1 are there"):
        varied_jobs([tmp_path], copies=1, crosses=1, seed=0)


def test_variations_are_not_varied_when_the_call_goes_on(tmp_path: Path):
    for name, seed in (("polka", 1), ("waltz", 2), ("jig", 3)):
        write_clip(tmp_path / f"{name}.h5", 40, seed, attributes={"name": name})
    first = varied_jobs([tmp_path], copies=1, crosses=1, seed=0)[1]
    assert [job.made_from for job in first[:3]] == ["jig", "polka", "waltz"]
    assert set(first[3].made_from.split(", ")) == {"jig", "polka", "waltz"}
    made = {"name": first[0].name, "made_from": first[0].made_from}
    write_clip(tmp_path / f"{first[0].name}.h5", motion=first[0].motion, attributes=made)
    again = varied_jobs([tmp_path], copies=1, crosses=1, seed=0)[1]
    assert [job.name for job in again] == [job.name for job in first]
    np.testing.assert_array_equal(again[3].motion.rotations, first[3].motion.rotations)


def test_clips_of_one_name_are_all_varied(tmp_path: Path):
    for folder, seed in (("a", 1), ("b", 2)):
        write_clip(tmp_path / folder / "waltz.h5", 20, seed, attributes={"name": "waltz"})
    jobs = varied_jobs([tmp_path / "a", tmp_path / "b"], copies=1, seed=0)[1]
    assert [job.name for job in jobs] == ["waltz_v1", "waltz_v1"]  # which `simulate_clips` then refuses


def test_clips_of_other_cloth_are_refused(tmp_path: Path):
    settings = ClothSettings()
    said = replace(settings, bend=2 * settings.bend)
    attributes = {"engine": ENGINE, "settings": said.describe()}
    write_clip(tmp_path / "waltz.h5", 20, attributes=attributes)
    with pytest.raises(ValueError, match=r"waltz\.h5 was simulated with other cloth \(bend .* there"):
        varied_jobs([tmp_path], copies=1, seed=0, settings=settings)
    assert varied_jobs([tmp_path], copies=1, seed=0, settings=said)[1]


def test_settings_that_came_later_are_at_their_defaults_in_older_clips(tmp_path: Path):
    settings = ClothSettings()
    before = ", ".join(part for part in settings.describe().split(", ") if "bend_bias" not in part)
    write_clip(tmp_path / "waltz.h5", 20, attributes={"engine": ENGINE, "settings": before})
    assert varied_jobs([tmp_path], copies=1, seed=0, settings=settings)[1]
    with pytest.raises(ValueError, match=r"other cloth \(bend_bias 1 there and 0\.5 here"):
        varied_jobs([tmp_path], copies=1, seed=0, settings=replace(settings, bend_bias=0.5))
