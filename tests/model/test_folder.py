"""Where a model may be saved: its own folder again or a new one; what is in the way stays as it is."""

import json
from pathlib import Path

import pytest

from garment_jax.cli import main
from garment_jax.model import folder as model_folder
from garment_jax.model.scene_file import read_sample
from garment_jax.model.store import load_model, save_model
from tests.animation.tiny_model import SCENE, tiny_model
from tests.reference.scene import make_motion, write_clip


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def refused(folder: Path, sentence: str) -> None:
    before = contents(folder)
    with pytest.raises(ValueError, match=sentence):
        save_model(tiny_model(), folder)
    assert contents(folder) == before


def test_saved_again_the_old_measurements_go_and_other_files_stay(tmp_path: Path):
    save_model(tiny_model(), tmp_path)
    for name in ("figures.json", "variants.json", "notes.txt"):
        (tmp_path / name).write_text("{}")
    save_model(tiny_model(), tmp_path, bits=32)
    names = ["config.toml", "model.json", "notes.txt", "parameters.npz"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert json.loads((tmp_path / "model.json").read_text())["bits"] == 32


def test_the_command_says_what_it_removed(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    first = save_model(tiny_model(), tmp_path / "first", bits=32)
    save_model(tiny_model(), tmp_path / "second")
    (tmp_path / "second" / "figures.json").write_text("{}")
    words = ["save", str(first), "--out", str(tmp_path / "second")]
    assert main(words) == 2
    assert "second holds a model; --force replaces it, or name another --out" in capsys.readouterr().err
    main([*words, "--force"])
    assert "removed figures.json, which belonged to the model replaced" in capsys.readouterr().out


def test_a_run_a_file_and_a_folder_of_other_things_are_refused(tmp_path: Path):
    run = tmp_path / "run"
    (run / "checkpoints").mkdir(parents=True)
    (run / "config.toml").write_text("# mine")
    refused(run, r"--out .*run is a run, whose files a model would replace; name another folder")
    other = tmp_path / "other"
    other.mkdir()
    (other / "letter.txt").write_text("dear")
    refused(other, r"--out .*other holds 'letter.txt' but no model; name another folder")
    refused(other / "letter.txt", r"letter.txt is a file; a model fills a folder")


def test_a_model_of_another_garment_is_refused(tmp_path: Path):
    save_model(tiny_model()._replace(garment_hash="0123"), tmp_path)
    refused(tmp_path, r"holds a model of another garment \(hash 0123, not \w+\); name another folder")
    (tmp_path / "model.json").write_text("{")
    refused(tmp_path, r"holds a damaged model \(model.json: .*\); name another folder")


def test_stopped_while_writing_the_old_model_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def stopped(path: Path, **arrays: object) -> None:
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    save_model(tiny_model(), tmp_path)
    (tmp_path / "figures.json").write_text("{}")
    before = contents(tmp_path)
    monkeypatch.setattr("numpy.savez_compressed", stopped)
    with pytest.raises(KeyboardInterrupt):
        save_model(tiny_model(), tmp_path, bits=32)
    assert contents(tmp_path) == before


@pytest.mark.parametrize("moves", [1, 2, 3])
def test_stopped_between_two_renames_nothing_loads_until_saved_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moves: int
):
    done, replace = [], model_folder.os.replace

    def stopped(source: Path, target: Path) -> None:
        if len(done) == moves:
            raise KeyboardInterrupt
        done.append(target)
        replace(source, target)

    save_model(tiny_model(), tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(model_folder.os, "replace", stopped)
        with pytest.raises(KeyboardInterrupt):
            save_model(tiny_model(), tmp_path, bits=32)
    with pytest.raises(FileNotFoundError, match=r"holds no model\.json"):
        load_model(tmp_path)
    save_model(tiny_model(), tmp_path, bits=32)
    load_model(tmp_path)
    assert not list(tmp_path.glob("*.replaced"))


def test_what_a_run_animates_is_saved_with_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("garment_jax.evaluation.portrait.template_portrait", lambda scene: b"a PNG")
    first = save_model(tiny_model(), tmp_path / "first")
    assert main(["save", str(first), "--out", str(tmp_path / "bare")]) == 0
    assert "its garment and body did not come along" in capsys.readouterr().out
    clip = write_clip(tmp_path / "polka.h5", scene=SCENE, motion=make_motion(SCENE, 4))
    assert main(["save", str(first), "--out", str(tmp_path / "second"), "--scene", str(clip)]) == 0
    assert main(["save", str(tmp_path / "second"), "--out", str(tmp_path / "third")]) == 0
    assert f"next: garment-jax animate {tmp_path / 'third'}" in capsys.readouterr().err
    found = read_sample(tmp_path / "third")
    assert found is not None
    assert len(found.motion.root) == 4
    assert (tmp_path / "third" / "picture.png").read_bytes() == b"a PNG"
