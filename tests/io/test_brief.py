"""What `info` says in ten lines."""

from pathlib import Path

from garment_jax.io.brief import LINES, brief_description, clip_errors
from garment_jax.io.info import describe
from tests.reference.scene import write_clip


def test_a_sequence_in_ten_lines(tmp_path: Path) -> None:
    many = {f"fact_{i}": i for i in range(20)}
    path = write_clip(tmp_path / "clip.h5", 12, attributes={"kind": "predicted", "name": "waltz", **many})
    lines = brief_description("clip.h5", describe(path)).splitlines()
    assert len(lines) == LINES
    assert lines[0] == "clip.h5"
    assert lines[1].split() == ["predicted", "waltz"]
    assert lines[2].split(maxsplit=1)[1] == "12 frames at 30 fps, 0.4 s"
    assert "128 vertices, 224 faces, 16 pinned" in lines[3]
    assert lines[5].split()[0] == "space"
    assert "fact_0" in lines[6]
    assert lines[-1] == "  (--all: every fact; --json: for programs)"


def test_a_run_in_ten_lines() -> None:
    clips = [{"clip": name, "metrics": {"rmse_cm": error}} for name, error in (("jump", 2.0), ("walk", 1.0))]
    config = {
        "data": {"dir": "data", "validation": ["waltz"]},
        "motion": {"steps": 90},
        "detail": {"steps": 0},
    }
    lines = brief_description("runs/x", {"config": config, "figures": clips}).splitlines()
    assert [line.split(maxsplit=1)[1] for line in lines[1:-1]] == [
        "motion 90",
        "data, validated on waltz",
        "RMSE 1.50 cm, the mean of 2 clips, worst 2.00 cm (jump)",
    ]


def test_a_value_of_any_length_is_a_line() -> None:
    text = brief_description("m", {"figures": {"trained_on": "ten words\nand " * 1000, "clips": {}}})
    assert text.count("\n") == 2
    assert max(map(len, text.splitlines())) < 120


def test_errors_of_every_form_of_figures() -> None:
    assert clip_errors({"clips": {"a": {"rmse_cm": 3.5}, "b": {}}}) == {"a": 3.5}
    assert clip_errors({"clip": "a", "metrics": {"rmse_cm": 2}}) == {"a": 2.0}
    assert clip_errors({"rmse_cm": 3.5}) == clip_errors(None) == clip_errors(["x"]) == {}
