"""Measuring a model's variants: errors by value, what is known stays, what does not belong is refused."""

import json
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from garment_jax.animation.variants import VARIANTS, stored_variants
from garment_jax.bench import variants
from garment_jax.bench.variants import measure_variants
from garment_jax.cli import main
from garment_jax.model.store import save_model
from garment_jax.structs import Motion, Scene
from tests.animation.tiny_model import SCENE, tiny_model
from tests.reference.scene import make_motion, make_scene, make_vertices, write_clip

OFF = {"whole": 0.01, "latents alone": 0.03}  # metres that the fake rollouts are off


class Piece(NamedTuple):
    V: np.ndarray


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A saved model, two clips of its scene and one of another; rollouts are the truth moved aside."""
    save_model(tiny_model(), tmp_path / "model")
    for name, scene in (("a", SCENE), ("b", SCENE), ("other", make_scene(7, 16))):
        write_clip(tmp_path / f"{name}.h5", scene=scene, motion=make_motion(scene, 6), encoding="float32")

    def animator(model, scene: Scene, *, detail: bool, collision: bool):
        aside = OFF["whole" if detail and collision else "latents alone"]

        def run(motion: Motion) -> list[Piece]:
            V = make_vertices(scene, motion)
            return [
                Piece(V[:4] + np.array([0, 0, aside], np.float32)),
                Piece(V[4:] + np.array([0, 0, aside], np.float32)),
            ]

        return run

    monkeypatch.setattr(variants, "make_animator", animator)
    monkeypatch.setattr(variants, "variants_of", lambda parts: {name: VARIANTS[name] for name in OFF})
    monkeypatch.setattr(
        variants, "measured_ms", lambda model, scene, motion, variant: 4.0 - 2.0 * (not variant.detail)
    )
    return tmp_path


def test_errors_then_times_are_what_a_budget_reads(folder: Path, capsys: pytest.CaptureFixture) -> None:
    command = ["variants", str(folder / "model"), "--validation", str(folder / "a.h5"), "--every", "3"]
    assert main([*command, "--test", str(folder / "b.h5"), "--errors"]) == 0
    table = json.loads((folder / "model" / "variants.json").read_text())
    for row in table["variants"]:
        assert row["rmse_cm"] == {"a": pytest.approx(100 * OFF[row["name"]], abs=1e-3)} | {
            "b": pytest.approx(100 * OFF[row["name"]], abs=1e-3)
        }
        assert row["error_cm"] == pytest.approx(row["rmse_cm"]["a"] + row["depth_cm"]["a"], abs=2e-4)
    assert main([*command, "--times"]) == 0
    rows, detail_mm = stored_variants(folder / "model")
    assert [(row.name, row.ms) for row in rows] == [("whole", 4.0), ("latents alone", 2.0)]
    assert [row.error_cm for row in rows] == [row["error_cm"] for row in table["variants"]]
    assert detail_mm == pytest.approx(0.0, abs=1e-3)  # between two rollouts without collisions: as far aside
    assert "latents alone: 2.00 ms a frame" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["a.h5"], "nothing is asked for; give --errors, --times or both"),
        (
            ["a.h5", "other.h5", "--errors"],
            "has another garment or body than a; take clips of one scene",
        ),
        (["a.h5", "--times", "--every", "0"], "--every 0 and --frames 0: give 1 or more"),
        (["nowhere.h5", "--times"], r"nowhere\.h5"),
    ],
)
def test_what_cannot_be_measured_is_refused(
    folder: Path, monkeypatch, capsys, words: list[str], sentence: str
):
    monkeypatch.chdir(folder)
    assert main(["variants", "model", "--validation", *words]) == 2
    assert re.search(sentence, capsys.readouterr().err)
    assert not (folder / "model" / "variants.json").exists()


def test_a_damaged_file_is_refused_and_kept(folder: Path) -> None:
    path = folder / "model" / "variants.json"
    path.write_text("{")
    with pytest.raises(ValueError, match=r"variants\.json is damaged .*; delete it to measure all anew"):
        measure_variants(folder / "model", [folder / "a.h5"], errors=False, times=True)
    assert path.read_text() == "{"
