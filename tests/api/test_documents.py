"""The examples of docs/api.md and of the README run as they stand, on a tiny model; `help` is a page."""

import inspect
import os
import pydoc
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import garment_jax as gj
from garment_jax.animation.variants import without_lengths
from garment_jax.config import to_toml
from garment_jax.farm.work import Outcome
from garment_jax.io.sequence import open_sequence
from garment_jax.model.store import save_model
from tests.animation.tiny_model import CONFIG, SCENE, tiny_model
from tests.api.tiny import SAMPLE
from tests.reference.files import write_bvh
from tests.reference.scene import make_vertices, write_clip

ROOT = Path(__file__).parents[2]


def blocks(document: str) -> list[str]:
    text = (ROOT / document).read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which a user may be: a `skirt` of 128 vertices, and nothing that takes long.

    The body carries simulated cloth, and training ends with the model that is there.
    """
    monkeypatch.chdir(tmp_path)
    scene = SCENE._replace(collider=None)  # the solver's programs take long to make
    model = without_lengths(tiny_model())
    model = model._replace(params={k: v for k, v in model.params.items() if k != "detail"})
    save_model(model, tmp_path / "skirt", bits=32, sample=SAMPLE._replace(scene=scene))
    for name in ("walk", "jump"):
        write_bvh(tmp_path / f"{name}.bvh", SCENE.body, SAMPLE.motion)
    (tmp_path / "configs").mkdir()
    (tmp_path / "configs" / "mine.toml").write_text(to_toml(CONFIG))

    def trained(config, run_dir, *, data_dir, stage):
        assert list(Path(data_dir).glob("train/*.h5"))
        assert (config.motion.steps, stage) == (4, "all")
        return shutil.copytree("skirt", run_dir)

    def simulated(scene, tasks, settings, **options):
        for i, task in tasks.items():
            yield i, Outcome(task.finish(scene, make_vertices(scene, task.motion), 1.0, "a machine"))

    monkeypatch.setattr("garment_jax.simulation.clips.simulate_many", simulated)
    monkeypatch.setattr("garment_jax.training.pipeline.train", trained)
    monkeypatch.setattr("garment_jax.simulation.clips.faults", lambda *_: [])
    return tmp_path


def test_the_page_runs_as_it_stands(here: Path):
    names: dict = {}
    for block in blocks("docs/api.md"):
        exec(compile(block, "docs/api.md", "exec"), names)
    assert names["V"].shape == (2, 128, 3)
    assert names["figures"]["clip"] == "jump"
    made = {path.name for path in here.iterdir()}
    assert {"walk.glb", "jump.h5", "jump.usdc", "data", "runs"} <= made
    with open_sequence(here / "jump.h5") as clip:
        assert clip.attributes["kind"] == "predicted"


def test_the_readmes_loop_has_at_most_eight_lines_and_runs(here: Path):
    (block,) = blocks("README.md")
    assert len(block.strip().splitlines()) <= 8
    names: dict = {}
    exec(compile(block, "README.md", "exec"), names)
    assert names["V"].shape == (128, 3)


def test_help_is_a_page_with_an_example_of_everything():
    text = pydoc.render_doc(gj, renderer=pydoc.plaintext)
    assert 'model = gj.load("skirt")' in text
    assert "_FILES" not in text
    assert "__getattr__" not in text
    for name in gj.__all__:
        assert f"\n    {name}(" in text
        doc = inspect.getdoc(getattr(gj, name))
        assert doc is not None
        assert re.search(rf"^    .*\bgj\.{name}\(|^    model\.", doc, re.MULTILINE), name
        assert set(gj.__all__) <= set(dir(gj))
    with pytest.raises(AttributeError, match="has no attribute 'anmate'"):
        _ = gj.anmate  # type: ignore[attr-defined]


def test_nothing_is_loaded_before_it_is_used_and_a_room_takes_no_functions_place():
    code = (
        "import sys, garment_jax as gj\n"
        "assert not {'jax', 'numpy'} & set(sys.modules)\n"
        "import garment_jax.exporters.command, garment_jax.evaluation.command\n"
        "assert all(callable(getattr(gj, name)) for name in gj.__all__)\n"
        "import os; assert os.environ['TF_CPP_MIN_LOG_LEVEL'] == '3'"
    )
    environment = {k: v for k, v in os.environ.items() if k != "TF_CPP_MIN_LOG_LEVEL"}
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment, check=True)


def test_clips_are_simulated_of_files_and_of_the_packages_own(here: Path):
    files = gj.simulate("skirt", "walk.bvh", "made", vertices=300, cloth={"bend": 1e-3})
    assert files == [Path("made/train/walk.h5")]
    with open_sequence(files[0]) as clip:
        assert "bend 0.001" in clip.attributes["settings"]
    with pytest.raises(ValueError, match=r"skirt\.obj needs a body"):
        gj.simulate("skirt.obj", "walk.bvh", "made")
    with pytest.raises(ValueError, match="garment 'scarf' is unknown; choose one of skirt"):
        gj.simulate("scarf", None, "made")


def test_a_clip_of_the_truth_is_measured(here: Path):
    scene = SCENE._replace(collider=None)
    truth = write_clip(here / "truth.h5", scene=scene, motion=SAMPLE.motion)
    figures = gj.evaluate(gj.load("skirt"), truth, every=9)
    assert figures["prediction"] == "skirt"
    gj.animate(gj.load("skirt"), truth, out="predicted.h5")
    again = gj.evaluate("predicted.h5", truth, every=9)
    assert figures["metrics"] == again["metrics"]
    assert np.isfinite(figures["metrics"]["rmse_cm"])
