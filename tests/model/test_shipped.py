"""Models that come with the package: found by name, complete, small; listed by `garment-jax models`."""

import json
import tomllib
from pathlib import Path

import pytest

from garment_jax.cli import main
from garment_jax.model.scene_file import read_sample
from garment_jax.model.shipped import find_model, shipped_model, shipped_models
from garment_jax.model.store import load_model, template_for

ROOT = Path(__file__).parents[2]


def test_every_shipped_model_is_whole_and_at_most_12_MB():
    assert set(shipped_models()) >= {"skirt", "dress", "circle_skirt", "cape"}
    for folder in shipped_models().values():
        names = {path.name for path in folder.iterdir()}
        assert names >= {"scene.h5", "picture.png", "figures.json", "LICENSES.md"}, folder
        assert sum(path.stat().st_size for path in folder.iterdir()) <= 12e6
        assert (folder / "picture.png").read_bytes()[:4] == b"\x89PNG"
        model, sample = load_model(folder), read_sample(folder)
        assert sample is not None
        assert sample.motion.fps == model.fps
        assert 9 <= len(sample.motion.root) / model.fps <= 11
        template_for(model, sample.scene, "its own scene")


@pytest.mark.parametrize(
    "words",
    [
        ["export", "skirt", "--format", "usd"],
        ["collide", "skirt"],
        ["render", "skirt"],
        ["view", "skirt"],
        ["validate", "skirt"],
        ["evaluate", "skirt", "truth.h5"],
    ],
)
def test_a_name_where_a_clip_is_asked_for_says_how_one_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, words: list[str]
):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    said = "error: skirt is a model; garment-jax animate skirt --out skirt.h5 makes a clip of it.\n"
    assert capsys.readouterr().err == said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "called"),
    [
        (["save", "skirt", "--out", "mine"], "garment_jax.training.pipeline.trained_model"),
        (["stability", "skirt"], "garment_jax.stability.report.stability"),
        (["variants", "skirt", "--validation", "a.h5"], "garment_jax.bench.variants.measure_variants"),
    ],
)
def test_commands_on_models_take_a_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, words: list[str], called
):
    def opened(folder: Path, *_: object, **__: object):
        raise ValueError(f"opened {folder}")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(called, opened)
    assert main(words) == 2
    assert capsys.readouterr().err == f"error: opened {find_model('skirt')}\n"
    assert main([words[0], "skrit", *words[2:]]) == 2
    assert "there is no model skrit; do you mean skirt?" in capsys.readouterr().err


def test_a_name_a_folder_and_what_is_neither(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    assert find_model("skirt") == find_model("models/skirt") == ROOT / "models" / "skirt"
    (tmp_path / "skirt").mkdir()  # of clips, say
    assert find_model("skirt") == ROOT / "models" / "skirt"
    (tmp_path / "skirt" / "config.toml").write_text("")
    assert find_model("skirt") == Path("skirt")  # one's own model comes first
    (tmp_path / "mine").mkdir()
    assert find_model("mine") == Path("mine")
    with pytest.raises(FileNotFoundError, match=r"there is no model skrit; do you mean skirt\?"):
        find_model("skrit")
    with pytest.raises(FileNotFoundError, match="there is no model elsewhere/x; name a folder, or one of"):
        find_model("elsewhere/x")
    (tmp_path / "file").write_text("")
    with pytest.raises(FileNotFoundError, match="file is a file; name a model's folder"):
        find_model("file")


def test_what_a_checkout_calls_it_is_known_elsewhere(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert shipped_model("other/skirt") is shipped_model("skrit") is None
    for name in ("cape", "models/cape"):
        assert shipped_model(name) == ROOT / "models" / "cape"
        assert main(["info", name]) == 0
        assert "900 vertices at 30 fps" in capsys.readouterr().out


def test_the_list_has_sizes_times_errors_and_pictures(capsys: pytest.CaptureFixture[str]):
    assert main(["models"]) == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.split() == ["name", "vertices", "MB", "ms/frame", "RMSE", "cm", "picture"]
    listed = {row.split()[0]: row.split() for row in rows}
    assert set(listed) == set(shipped_models())
    figures = json.loads((shipped_models()["skirt"] / "figures.json").read_text(encoding="utf-8"))
    errors = [clip["rmse_cm"] for clip in figures["clips"].values()]
    assert (listed["skirt"][1], listed["skirt"][4]) == ("2800", f"{sum(errors) / len(errors):.2f}")
    for _, vertices, size, ms, error, picture in listed.values():
        assert 0 < float(ms) < float(vertices)
        assert 0 < float(size) <= 12
        assert 0 < float(error) < 10
        assert Path(picture).is_file()


def test_what_is_installed_has_the_models(monkeypatch: pytest.MonkeyPatch):
    """setup.py maps the folder; without this the wheel would have no models."""
    given = {}
    monkeypatch.setattr("setuptools.setup", lambda **options: given.update(options))
    monkeypatch.chdir(ROOT)
    exec((ROOT / "setup.py").read_text(encoding="utf-8"))
    assert given["package_dir"]["garment_jax.models"] == "models"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["tool"]["setuptools"]["package-data"]["garment_jax.models"] == ["*/*"]
    assert given["package_dir"]["garment_jax.configs"] == "configs"
    assert project["tool"]["setuptools"]["package-data"]["garment_jax.configs"] == ["*.toml"]
    assert {"garment_jax", "garment_jax.cli", "garment_jax.configs", "garment_jax.models"} <= set(
        given["packages"]
    )
