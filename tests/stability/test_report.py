"""The command: tables, the JSON file, plots, exit codes, refusals."""

import json
from pathlib import Path

import pytest

from garment_jax.cli import main
from garment_jax.stability import report
from garment_jax.stability.case import Curve, Findings, at_most, left_out
from tests.animation.tiny_model import SCENE
from tests.reference.scene import make_motion, make_scene, write_clip


@pytest.fixture
def clip(tmp_path: Path) -> str:
    return str(write_clip(tmp_path / "waltz.h5", scene=SCENE, motion=make_motion(SCENE, 30)))


def stub(value: float, why: str = "no RUN given"):
    cases = [at_most("g", "first", "depth", value, 1.0, "mm"), left_out("g", "second", why)]
    return {"skinning": lambda subject: Findings(cases, [Curve("skinning", "depth", [1, 2], [value, 2.0])])}


@pytest.mark.parametrize(("value", "code"), [(0.5, 0), (1.5, 1), (float("nan"), 1)])
def test_a_red_case_makes_the_exit_code_1_and_all_is_written(
    tmp_path, monkeypatch, capsys, clip, value, code
):
    monkeypatch.setattr(report, "GROUPS", stub(value))
    out = tmp_path / "out"
    assert main(["stability", "--clips", clip, "--out", str(out)]) == code
    said = capsys.readouterr().out
    assert "| first" in said
    assert f"{1 - code} green, {code} red, 1 left out" in said
    facts = json.loads((out / "stability.json").read_text())
    assert facts["passed"] == (code == 0)
    assert [case["case"] for case in facts["cases"]] == ["first", "second"]
    assert facts["cases"][0]["value"] == (None if value != value else value)
    assert sorted(path.name for path in out.iterdir()) == ["stability.json", "stability_skinning.png"]


def test_without_out_nothing_is_written_and_nothing_is_drawn(tmp_path, monkeypatch, capsys, clip):
    monkeypatch.setattr(report, "GROUPS", stub(0.5))
    assert main(["stability", "--clips", str(tmp_path)]) == 0
    assert "the clips' garment of 128 vertices" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["waltz.h5"]


def test_the_embedded_garment_needs_no_files(monkeypatch, capsys):
    seen = []
    monkeypatch.setattr(report, "GROUPS", {"skinning": lambda subject: seen.append(subject) or Findings([])})
    monkeypatch.setattr("garment_jax.stability.subject.make_scene", lambda name, *, vertices: SCENE)
    assert main(["stability", "--garment", "dress"]) == 0
    assert "embedded dress" in capsys.readouterr().out
    assert [name for name, _ in seen[0].motions] == ["kick", "twirl", "dance"]
    assert seen[0].model is None


def test_clips_of_two_garments_and_unknown_names_are_refused(tmp_path, capsys, clip):
    other = make_scene(7, 16)
    second = str(write_clip(tmp_path / "other.h5", 6, scene=other, motion=make_motion(other, 6)))
    (tmp_path / "empty").mkdir()
    for words, sentence in (
        (["--clips", clip, second], "other.h5 has a garment of 112 vertices and"),
        (["--clips", str(tmp_path / "empty")], "holds no sequence files"),
        (["--clips", clip, "--garment", "dress"], "--garment dress and --clips name two garments"),
        (["--only", "sewing"], "--only 'sewing' is unknown; choose of skinning, stiff, deep"),
        ([str(tmp_path / "empty")], "holds no config.toml"),
    ):
        assert main(["stability", *words]) == 2
        assert sentence in capsys.readouterr().err
