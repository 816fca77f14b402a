"""The predictability floor: nothing for a clip that forgets, a refusal for a restart outside it."""

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from garment_jax.cli import main
from garment_jax.io.sequence import open_sequence
from garment_jax.simulation.floor import Floor, floor_of, summary
from garment_jax.simulation.settings import ClothSettings
from tests.reference.scene import make_motion, make_scene, write_clip


def test_figures_are_those_of_the_curve():
    motion = make_motion(make_scene(), 201)
    figures = summary(Floor("dance", 100, np.linspace(3.0, 1.0, 201), motion, np.zeros((201, 1, 3))))
    assert figures["rmse_cm_at_restart"] == 3.0
    assert figures["rmse_cm_after_25"] == pytest.approx(2.75)
    assert figures["rmse_cm_after_200"] == 1.0
    assert figures["rmse_cm"] == pytest.approx(np.sqrt(np.mean(np.linspace(3.0, 1.0, 201) ** 2)))


def test_a_restart_outside_the_clip_is_refused(tmp_path: Path):
    pytest.importorskip("newton")
    sentence = "--start 12 is not inside .*, which has 12 frames"
    with (
        open_sequence(write_clip(tmp_path / "clip.h5", 12)) as clip,
        pytest.raises(ValueError, match=sentence),
    ):
        floor_of(clip, ClothSettings(), start=12)


def test_frames_from_the_restart_on_are_compared(tmp_path: Path):
    pytest.importorskip("newton")
    settings = ClothSettings(substeps=4, iterations=3, linear_iterations=10, settle=2, blend=1, hold=1)
    with open_sequence(write_clip(tmp_path / "clip.h5", 12)) as clip:
        floor = floor_of(clip, settings, start=5, frames=4)
    assert floor.rmse_cm.shape == (4,)
    assert np.isfinite(floor.rmse_cm).all()
    assert floor.V.shape == (4, len(make_scene().garment.template), 3)
    np.testing.assert_array_equal(floor.motion.root, make_motion(make_scene(), 12).root[5:9])


def test_the_clips_own_cloth_goes_on_as_it_did(tmp_path: Path):
    pytest.importorskip("newton")
    from garment_jax.simulation.clips import Job, simulate_clips
    from garment_jax.simulation.screening import ScreenLimits

    scene, motion = make_scene(), make_motion(make_scene(), 12)
    anything = ScreenLimits(1e9, 1e9, 1e9, 1e9)
    settings = ClothSettings(substeps=4, iterations=3, linear_iterations=10, settle=2, blend=1, hold=1)
    path = simulate_clips(scene, [Job("clip", "train", motion)], tmp_path, settings, limits=anything)[0].path
    assert path is not None
    with open_sequence(path) as clip:
        same = floor_of(clip, settings, start=3, frames=6, own_start=True).rmse_cm
        other = replace(settings, gravity=2.0)
        assert same[0] < 0.003  # what 16 bits round away
        assert summary(floor_of(clip, settings, start=3, frames=6, own_start=True))[
            "rmse_cm_at_end"
        ] == pytest.approx(same[-1])
        assert floor_of(clip, other, start=3, frames=6, own_start=True).rmse_cm[-1] > 3 * same[-1]
        for start in (0, 11):
            with pytest.raises(ValueError, match=f"a frame before and after --start {start} of .*clip"):
                floor_of(clip, settings, start=start, own_start=True)


def test_the_command_prints_a_list_that_the_benchmark_reads(tmp_path: Path, monkeypatch, capsys):
    clips = [str(write_clip(tmp_path / f"{name}.h5", 12)) for name in ("a", "b")]

    def restart(clip, settings, *, start, frames, flat, own_start):
        return Floor(clip.path.stem, start, np.full(3, 2.5), clip.motion, np.zeros((3, 1, 3), np.float32))

    monkeypatch.setattr("garment_jax.simulation.floor.floor_of", restart)
    assert main(["floor", *clips, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [(f["clip"], f["rmse_cm"], len(f["rmse_cm_per_frame"])) for f in found] == [
        ("a", 2.5, 3),
        ("b", 2.5, 3),
    ]
    other = str(write_clip(tmp_path / "pred.h5", 12, attributes={"kind": "predicted"}))
    assert main(["floor", clips[0], other, clips[1], "--json"]) == 2  # one clip's fault is that clip's
    said = capsys.readouterr()
    assert [f["clip"] for f in json.loads(said.out)] == ["a", "b"]
    assert "left out: " in said.err
    assert said.err.endswith("pred.h5; the reasons are above.\n")
    assert main(["floor", *clips, "--out", str(tmp_path / "again.h5")]) == 2
    assert "holds one clip, and 2 are given; name one" in capsys.readouterr().err


def test_another_start_may_be_asked_for_and_no_other_cloth(tmp_path: Path, monkeypatch, capsys):
    settled = ClothSettings(settle=45)
    attributes = {"engine": "newton SolverStyle3D", "settings": settled.describe()}
    clip = str(write_clip(tmp_path / "clip.h5", 3, attributes=attributes))
    asked = []

    def restart(clip, settings, *, start, frames, flat, own_start):
        asked.append(settings)
        return Floor(clip.path.stem, start, np.full(3, 2.5), clip.motion, clip.read(0, 3))

    monkeypatch.setattr("garment_jax.simulation.floor.floor_of", restart)
    assert main(["floor", clip, "--start", "0", "--cloth", "settle=60"]) == 0
    assert asked == [replace(settled, settle=60)]
    assert main(["floor", clip, "--start", "0", "--cloth", "settle=60", "bend=1"]) == 2
    assert "was simulated with other cloth (bend 0.0003 there and 1 here)" in capsys.readouterr().err


def test_a_prediction_is_no_simulation_to_repeat_and_no_file_of_others_is_replaced(tmp_path: Path, capsys):
    clip = str(write_clip(tmp_path / "clip.h5", 12))
    pred = str(write_clip(tmp_path / "pred.h5", 12, attributes={"kind": "predicted"}))
    assert main(["floor", pred]) == 2
    assert "pred.h5 is predicted, not simulated; give the clip" in capsys.readouterr().err
    assert main(["floor", clip, "--out", pred]) == 2
    assert "pred.h5 is there already; --force replaces it" in capsys.readouterr().err


def test_the_second_simulation_says_what_it_is_and_may_be_written_again(tmp_path: Path, monkeypatch, capsys):
    clip, out = str(write_clip(tmp_path / "clip.h5", 3)), tmp_path / "again.h5"

    def restart(clip, settings, *, start, frames, flat, own_start):
        return Floor(clip.path.stem, start, np.full(3, 2.5), clip.motion, clip.read(0, 3))

    monkeypatch.setattr("garment_jax.simulation.floor.floor_of", restart)
    for force in ([], ["--force"]):
        assert main(["floor", clip, "--start", "0", "--out", str(out), *force]) == 0
    with open_sequence(out) as again:
        assert again.attributes["kind"] == "simulated"
        assert again.attributes["restarted_at_frame"] == 0


def test_floor_refuses_what_would_end_in_nonsense_before_it_simulates(tmp_path: Path, capsys):
    pytest.importorskip("newton")
    clip = write_clip(tmp_path / "clip.h5", 12, encoding="float32")
    with h5py.File(clip, "r+") as file:
        file["vertices"][7, 5, 1] = np.nan
    assert main(["floor", str(clip), "--start", "3"]) == 2
    assert "clip.h5: vertex 5 of frame 7 is" in capsys.readouterr().err
    large = make_scene()
    body = large.body._replace(vertices=large.body.vertices * 100, joints=large.body.joints * 100)
    clip = write_clip(tmp_path / "cm.h5", 12, scene=large._replace(body=body), encoding="float32")
    assert main(["floor", str(clip), "--start", "3"]) == 2
    assert "looks like centimetres" in capsys.readouterr().err
