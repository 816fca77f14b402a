"""Clips side by side against the same clips one by one in Newton's solver; on a GPU where there is one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from garment_jax.io.sequence import open_sequence
from garment_jax.simulation import many
from garment_jax.simulation.clips import Job, simulate_clips
from garment_jax.simulation.screening import ScreenLimits
from garment_jax.simulation.settings import ClothSettings
from garment_jax.structs import Motion, Scene
from tests.reference.scene import make_motion, make_scene

pytest.importorskip("newton")
from garment_jax.simulation import conjugate_gradients
from garment_jax.simulation.engine import wp
from garment_jax.simulation.newton_cloth import drape, simulate_frames
from garment_jax.simulation.side_by_side import SideBySide

SETTINGS = ClothSettings(substeps=4, settle=2, blend=3, hold=1)
THICK = replace(SETTINGS, self_collision=True, self_collision_radius=0.02)  # metres: folds are far apart
LOOSE = ScreenLimits(deepest_mm=1e4, inside_percent=100.0, strain_p99_percent=1e4, hem_rise_cm=1e3)
DEVICES = ["cpu", *(device.alias for device in wp.get_devices() if device.is_cuda)]


def motions(scene: Scene) -> list[Motion]:
    """Clips of other lengths, places and headings."""
    made = [make_motion(scene, frames, seed, fps=30.0) for frames, seed in ((9, 0), (5, 1), (7, 2))]
    return [motion._replace(root=motion.root + [3.0 * i, 0.0, -i]) for i, motion in enumerate(made)]


def variant(name: str) -> Scene:
    scene = make_scene(8, 24)
    if name == "whole body":
        return scene._replace(collider=None)
    return scene._replace(pins=None) if name == "no pins" else scene


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("name", ["collider and pins", "whole body", "no pins", "self-collision", "large"])
def test_each_clip_is_what_it_is_alone(name: str, device: str, monkeypatch: pytest.MonkeyPatch):
    scene = variant(name)
    if name == "large":  # as a GPU solves garments that do not fit a block of its threads
        if device == "cpu":
            pytest.skip("a CPU solves garments of all sizes in one way")
        monkeypatch.setattr(conjugate_gradients, "MOST_HELD", 0)
    settings = THICK if name == "self-collision" else SETTINGS
    draped, given = drape(scene, settings), motions(scene)
    shaken = draped._replace(positions=draped.positions + np.float32(1e-7))
    together = SideBySide(scene, settings, None, 4, device).simulate(given, drape=draped)
    for motion, V in zip(given, together, strict=True):
        alone, again = (
            np.stack(list(simulate_frames(scene, motion, settings, drape=start)))
            for start in (draped, shaken)
        )
        assert V.shape == alone.shape
        # rounding, and what cloth makes of it: as much as of a tenth of a micrometre at the start; where that
        # has become a millimetre (free cloth on some processors) nothing can be known any more
        apart = np.maximum.accumulate(np.abs(again - alone).max(axis=(1, 2)))
        known = apart < 1e-3
        assert known.sum() >= 4
        allowed = 30.0 * apart[known].max()
        assert allowed < 0.5 * np.abs(alone[-1] - alone[0]).max()
        np.testing.assert_allclose(V[known], alone[known], atol=allowed)


@pytest.mark.parametrize("device", DEVICES)
def test_the_same_clips_give_the_same_bits_again_and_in_another_company(device: str):
    scene = make_scene(8, 24)
    draped, (first, second, third) = drape(scene, SETTINGS), motions(scene)
    cloths = SideBySide(scene, SETTINGS, None, 2, device)
    once = cloths.simulate([first, second], drape=draped)
    again = cloths.simulate([first, third], drape=draped)
    np.testing.assert_array_equal(once[0], again[0])


def test_a_clip_that_is_lost_takes_no_other_with_it():
    scene = make_scene(8, 24)
    draped, (first, second, _) = drape(scene, SETTINGS), motions(scene)
    root = second.root.copy()
    root[2:] = np.nan
    kept, lost = SideBySide(scene, SETTINGS, None, 2, "cpu").simulate(
        [first, second._replace(root=root)], drape=draped
    )
    assert np.isfinite(kept).all()
    assert np.isfinite(lost[:2]).all()
    assert np.isnan(lost[2:]).all()


def test_progress_counts_the_frames_before_the_clips_too():
    scene = make_scene(8, 24)
    seen: list[tuple[int, int]] = []
    SideBySide(scene, SETTINGS, None, 1, "cpu").simulate(
        motions(scene)[1:2], drape=drape(scene, SETTINGS), progress=lambda *now: seen.append(now)
    )
    before = SETTINGS.settle + SETTINGS.blend + SETTINGS.hold - 1
    assert seen == [(k + 1, 5 + before) for k in range(5 + before)]


def test_what_it_cannot_do_is_refused():
    scene = make_scene(8, 24)
    with pytest.raises(ValueError, match="the device cuda:9 is not there; simulate here on cpu"):
        SideBySide(scene, SETTINGS, None, 2, "cuda:9")


@pytest.mark.parametrize("at_once", [2, 128])
def test_clips_are_screened_and_written_as_those_of_a_cpu(tmp_path: Path, monkeypatch, at_once: int):
    scene = make_scene(8, 24)
    jobs = [Job(f"clip_{k}", "train", motion) for k, motion in enumerate(motions(scene))]
    held: list[int] = []

    def on_this_cpu(scene, settings, flat, clips, device):
        held.append(clips)
        return SideBySide(scene, settings, flat, clips, "cpu")

    monkeypatch.setattr(many, "_side_by_side", on_this_cpu)
    lines: list[str] = []
    found = simulate_clips(
        scene,
        jobs,
        tmp_path / "many",
        SETTINGS,
        device="cuda",
        at_once=at_once,
        limits=LOOSE,
        progress=lines.append,
    )
    alone = simulate_clips(scene, jobs, tmp_path / "one", SETTINGS, limits=LOOSE, progress=lambda _: None)
    assert held == [min(at_once, 3)]  # three clips fill no more
    assert [outcome.job for outcome in found] == ["clip_0", "clip_1", "clip_2"]
    assert sum("kept" in line for line in lines) == 3
    for one, other in zip(found, alone, strict=True):
        assert one.path is not None
        assert other.path is not None
        with open_sequence(one.path) as a, open_sequence(other.path) as b:
            np.testing.assert_allclose(a.read(0, a.frames), b.read(0, b.frames), atol=4e-4)
            assert a.attributes["content_hash"] == b.attributes["content_hash"]
            assert a.attributes["simulated_on"] == wp.get_device("cpu").name


def test_none_at_once_are_refused_before_anything_is_done(tmp_path: Path):
    with pytest.raises(ValueError, match="at_once=0 must be 1 or more"):
        simulate_clips(make_scene(), [], tmp_path / "out", SETTINGS, device="cuda", at_once=0)
    assert not (tmp_path / "out").exists()
