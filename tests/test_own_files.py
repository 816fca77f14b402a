"""A user's own case from files alone: body, garment and BVH are simulated, trained on and animated."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import infer
import train
from garment_jax.cli import main as garment_jax
from garment_jax.config import DataConfig, to_toml
from garment_jax.data.sequence import open_sequence
from tests.reference.files import write_body, write_bvh, write_obj
from tests.reference.scene import make_motion
from tests.rollout.tiny_model import CONFIG, SCENE

CLOTH = ["settle=10", "blend=10", "hold=2"]


def test_from_files_to_an_animated_garment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    pytest.importorskip("newton")
    write_body(tmp_path / "me.npz", SCENE.body)
    write_obj(tmp_path / "skirt.obj", SCENE.garment)
    (tmp_path / "moves").mkdir()
    for k, name in enumerate(("walk", "run", "jump")):
        write_bvh(tmp_path / "moves" / f"{name}.bvh", SCENE.body, make_motion(SCENE, 18, seed=k))
    words = ["--garment", "skirt.obj", "--body", "me.npz", "--motion", "moves", "--test", "jump"]
    monkeypatch.chdir(tmp_path)
    assert garment_jax(["simulate", *words, "--out", "clips", "--cloth", *CLOTH]) == 0
    assert "clips: 3 of 3 clips" in capsys.readouterr().out

    small = replace(CONFIG, data=DataConfig(mirror=False))
    Path("mine.toml").write_text(to_toml(small))
    run = ["train", "mine.toml", "--data", "clips", "--run-dir", "run"]
    predict = ["infer", "run", "--motion", "clips/test/jump.h5", "--out", "jump.h5"]
    for program, arguments in ((train, run), (infer, predict)):
        monkeypatch.setattr(sys, "argv", arguments)
        assert program.main() == 0
    assert garment_jax(["evaluate", "jump.h5", "clips/test/jump.h5", "--every", "6"]) == 0
    assert "| jump | 18 |" in capsys.readouterr().out
    with open_sequence("jump.h5") as made:
        assert np.isfinite(made.read(0, 18)).all()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--garment", "skirt.obj"], "--body is not given; name your files, or use --embedded skirt"),
        (["--embedded", "skirt", "--cloth", "bend"], "'bend' needs a number"),
        (["--embedded", "skirt", "--frames", "10"], "--frames 10 are too few"),
    ],
)
def test_what_cannot_be_simulated_is_refused(tmp_path: Path, words, sentence, capsys):
    assert garment_jax(["simulate", *words, "--out", str(tmp_path / "clips")]) == 2
    captured = capsys.readouterr()
    assert sentence in captured.err
    assert not (tmp_path / "clips").exists()
