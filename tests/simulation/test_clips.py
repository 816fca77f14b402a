"""Many clips: written whole, gone on with, screened, the same with one process as with two."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from garment_jax import progress
from garment_jax.farm.shard import Shard
from garment_jax.io.sequence import open_sequence
from garment_jax.simulation.clips import ENGINE, Job, check_made, content_key, simulate_clips
from garment_jax.simulation.screening import ScreenLimits
from garment_jax.simulation.settings import ClothSettings
from garment_jax.storage.lock import lock_name, locked
from garment_jax.structs import Scene
from tests.reference.scene import make_motion, make_scene, write_clip

ROOT = Path(__file__).parents[2]
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


def test_a_clip_that_fails_leaves_none_of_other_settings(tmp_path: Path, scene, jobs):
    pytest.importorskip("newton")
    (kept,) = simulate_clips(scene, jobs[:1], tmp_path, SETTINGS, limits=LOOSE, progress=lambda _: None)
    assert kept.path is not None
    strict, other = replace(LOOSE, strain_p99_percent=1e-6), replace(SETTINGS, substeps=5)
    simulate_clips(scene, jobs[:1], tmp_path, other, limits=strict, progress=lambda _: None)
    assert not kept.path.exists()


MADE = {"engine": ENGINE, "content_hash": "of other settings"}


@pytest.mark.parametrize(
    ("attributes", "other_garment", "sentence"),
    [
        ({}, False, " and simulate did not make it"),
        ({"imported_from": "walk.abc", "content_hash": "0"}, False, " and simulate did not make it"),
        (MADE | {"source": "walk.bvh"}, False, " and simulate did not make it"),
        (MADE | {"kind": "predicted"}, False, " and simulate did not make it"),
        (MADE | {"collision_eps_m": 0.004}, False, " and simulate did not make it"),
        (MADE | {"restarted_at_frame": 100}, False, " and simulate did not make it"),
        (None, False, " and simulate did not make it"),
        (MADE, True, ", a clip of another garment or body"),
    ],
)
def test_what_simulate_did_not_make_of_this_garment_is_never_replaced(
    tmp_path: Path, scene, jobs, monkeypatch, attributes, other_garment, sentence
):
    pytest.importorskip("newton")
    monkeypatch.setattr("garment_jax.simulation.newton_cloth.drape", no_drape)
    (tmp_path / "test").mkdir()
    path = tmp_path / "test/two.h5"
    if attributes is None:
        path.write_text("no HDF5 file")
    else:
        write_clip(path, 4, scene=make_scene(7, 16) if other_garment else scene, attributes=attributes)
    before = path.read_bytes()
    with pytest.raises(ValueError, match=rf"two\.h5 is there{sentence}; choose another --out, or move it"):
        simulate_clips(scene, jobs, tmp_path, SETTINGS, progress=lambda _: None)
    assert path.read_bytes() == before


def test_a_clip_that_moves_replaces_no_import(tmp_path: Path, scene, jobs):
    motion, key = jobs[0].motion, content_key(scene, jobs[0].motion, SETTINGS, None)
    for split, attributes in (("train", {"content_hash": key}), ("test", {"imported_from": "walk.abc"})):
        (tmp_path / split).mkdir()
        write_clip(tmp_path / split / "one.h5", scene=scene, motion=motion, attributes=attributes)
    before = (tmp_path / "test/one.h5").read_bytes()
    with pytest.raises(ValueError, match=r"test/one\.h5 is there and simulate did not make it"):
        simulate_clips(scene, [jobs[0]._replace(split="test")], tmp_path, SETTINGS)
    assert (tmp_path / "test/one.h5").read_bytes() == before
    assert (tmp_path / "train/one.h5").exists()


def test_a_clip_moves_to_those_that_are_tested_on_and_is_never_in_both(tmp_path: Path, scene, jobs):
    (tmp_path / "train").mkdir()
    motion, key = jobs[0].motion, content_key(scene, jobs[0].motion, SETTINGS, None)
    write_clip(tmp_path / "train/one.h5", scene=scene, motion=motion, attributes={"content_hash": key})
    tested = [jobs[0]._replace(split="test")]
    simulate_clips(scene, tested, tmp_path, SETTINGS, progress=lambda _: None)
    assert [str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*.h5")] == ["test/one.h5"]
    with open_sequence(tmp_path / "test/one.h5") as clip:
        assert clip.attributes["split"] == "test"
    with pytest.raises(ValueError, match="one to train on must not be one to test on"):
        simulate_clips(scene, jobs[:1], tmp_path, replace(SETTINGS, substeps=5), progress=lambda _: None)


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


def no_drape(*_, **__):
    raise AssertionError("draped before the input was checked")


@pytest.mark.parametrize("workers", [0, -1])
def test_no_workers_are_refused_before_anything_is_simulated(tmp_path: Path, scene, jobs, workers: int):
    with pytest.raises(ValueError, match=f"workers={workers} must be 1 or more"):
        simulate_clips(scene, jobs, tmp_path, SETTINGS, workers=workers)


def test_what_engine_and_writer_would_refuse_is_refused_before_the_drape(
    tmp_path: Path, scene, jobs, monkeypatch
):
    pytest.importorskip("newton")
    monkeypatch.setattr("garment_jax.simulation.newton_cloth.drape", no_drape)
    garment, body = scene.garment, scene.body
    one = jobs[0].motion
    bare = scene._replace(collider=None, body=body._replace(faces=body.faces[:0]))
    wide = scene._replace(garment=garment._replace(uv=3 * garment.uv))
    heavy = scene._replace(body=body._replace(skin_weights=body.skin_weights * np.float32(2)))
    cases = [
        (scene, [*jobs, jobs[0]], r"two clips would be written to .*one\.h5; simulate one"),
        (
            scene,
            [jobs[0]._replace(motion=one._replace(fps=60.0))],
            "one has 60 fps, the settings 30; resample",
        ),
        (
            scene,
            [jobs[0]._replace(motion=one._replace(root=one.root * np.nan))],
            "`root` is not finite in row 0",
        ),
        (bare, jobs, "the body has 0 faces to touch"),
        (wide, jobs, "`uv` runs from 0 to 3; scale it"),
        (heavy, jobs, "a row of `body/skin_weights` sums to 2"),
    ]
    for broken, given, sentence in cases:
        with pytest.raises(ValueError, match=sentence):
            simulate_clips(broken, given, tmp_path / "out", SETTINGS, progress=lambda _: None)
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_is_refused_before_anything_is_simulated(tmp_path: Path, scene, jobs):
    (tmp_path / "file").write_text("taken")
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(OSError, match=r"file is no folder; choose another folder"):
            simulate_clips(scene, jobs, out, SETTINGS)


def test_frames_are_counted_on_stderr(tmp_path: Path, scene, jobs, monkeypatch, capsys):
    pytest.importorskip("newton")
    monkeypatch.setattr(progress, "_LINE_SECONDS", 0.0)
    monkeypatch.setattr(progress, "_FIRST_SECONDS", 0.0)
    simulate_clips(scene, jobs, tmp_path, SETTINGS, limits=LOOSE, progress=lambda _: None)
    lines = capsys.readouterr().err.splitlines()
    names = [line.split(",")[0] for line in lines]
    assert names[:2] == ["drape: 1/2 frames", "drape: 2/2 frames"]
    assert names[2] == "two: 1/12 frames"  # the longer clip first; 4 frames lead into its 8
    assert names[-1] == "one: 10/10 frames"
    assert len(lines) == 2 + 12 + 10
    assert all("frames/s" in line and line.endswith(" left") for line in lines)


def test_the_key_changes_with_everything_a_clip_depends_on(scene, jobs):
    motion = jobs[0].motion
    base = content_key(scene, motion, SETTINGS, None)
    assert content_key(scene, motion, SETTINGS, None) == base
    assert scene.pins is not None
    others = [
        content_key(scene, motion._replace(root=motion.root + 1e-3), SETTINGS, None),
        content_key(scene, motion, replace(SETTINGS, bend=1e-4), None),
        content_key(scene, motion, replace(SETTINGS, bend_bias=0.5), None),
        content_key(scene, motion, replace(SETTINGS, turn_in=True), None),
        content_key(scene, motion, SETTINGS, scene.garment.uv),
        content_key(scene._replace(pins=None), motion, SETTINGS, None),
        content_key(scene._replace(collider=None), motion, SETTINGS, None),
    ]
    assert len({base, *others}) == 8


WORKER = """
import multiprocessing, os, time
from concurrent.futures import ProcessPoolExecutor
from garment_jax.farm.local import end_with_parent
if __name__ == "__main__":
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context, initializer=end_with_parent) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        pool.submit(time.sleep, 600).result()
"""


def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path):
    (tmp_path / "pool.py").write_text(WORKER)
    with subprocess.Popen([sys.executable, tmp_path / "pool.py"], stdout=subprocess.PIPE, cwd=ROOT) as parent:
        assert parent.stdout is not None
        worker = int(parent.stdout.readline())
        parent.kill()
    for _ in range(100):
        try:
            os.kill(worker, 0)
        except ProcessLookupError:
            return
        time.sleep(0.1)
    os.kill(worker, signal.SIGKILL)
    pytest.fail("the worker went on")


def test_shards_beside_each_other_are_the_whole(tmp_path: Path, scene, jobs):
    pytest.importorskip("newton")
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    simulate_clips(scene, jobs, whole, SETTINGS, limits=LOOSE, progress=lambda _: None)
    with locked(parts, "simulating clips", name=lock_name(f"shard {Shard(2, 3)}")):  # another process' part
        first = simulate_clips(
            scene, jobs, parts, SETTINGS, limits=LOOSE, shard=Shard(1, 3), progress=lambda _: None
        )
        with pytest.raises(OSError, match="is simulating clips"):
            simulate_clips(scene, jobs, parts, SETTINGS, shard=Shard(2, 3), progress=lambda _: None)
    rest = [
        simulate_clips(scene, jobs, parts, SETTINGS, limits=LOOSE, shard=Shard(k, 3), progress=lambda _: None)
        for k in (2, 3)
    ]
    assert [[outcome.job for outcome in done] for done in (first, *rest)] == [["one"], ["two"], []]
    for name in ("train/one.h5", "test/two.h5"):
        assert (whole / name).read_bytes() == (parts / name).read_bytes()


def test_a_clip_that_cannot_be_made_is_named_and_the_others_are_there(
    tmp_path: Path, scene, jobs, monkeypatch
):
    pytest.importorskip("newton")
    from garment_jax.simulation import newton_cloth

    simulated = newton_cloth.simulate_frames

    def full(scene, motion, *arguments, **options):
        if len(motion.root) == 8:
            raise OSError("the disk is full.")
        return simulated(scene, motion, *arguments, **options)

    monkeypatch.setattr(newton_cloth, "simulate_frames", full)
    lines: list[str] = []
    made, failed = simulate_clips(scene, jobs, tmp_path, SETTINGS, limits=LOOSE, progress=lines.append)
    assert made.path is not None
    assert made.path.exists()
    assert (failed.path, failed.error) == (None, "the disk is full.")
    assert any("two: 8 frames" in line and "left out: the disk is full." in line for line in lines)
    with pytest.raises(OSError, match=r"^two: the disk is full"):
        check_made([made, failed])
