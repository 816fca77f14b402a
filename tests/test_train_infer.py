"""`train.py` and `infer.py`: they parse, call and print; refusals are one sentence and exit code 2."""

import json
import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import infer
import train
from garment_jax.animation.variants import VARIANTS, variants_of
from garment_jax.cli import main as garment_jax
from garment_jax.config import to_toml
from garment_jax.io.sequence import open_sequence
from garment_jax.model.store import save_model
from garment_jax.training.run_directory import prepare_run
from tests.animation.tiny_model import CONFIG, SCENE, tiny_model
from tests.reference.scene import make_motion, make_scene, write_clip
from tests.reference.tiny_column_rnn import column_rnn_model

ROOT = Path(__file__).parents[1]
STARTS = ("prepare: ", "train: ", "infer: ")  # lines that say what is being done


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(save_model(tiny_model(), tmp_path_factory.mktemp("model")))


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("clips") / "polka.h5"
    return str(write_clip(path, scene=SCENE, motion=make_motion(SCENE, 18), attributes={"name": "polka"}))


@pytest.fixture
def config(tmp_path: Path) -> str:
    path = tmp_path / "tiny.toml"
    path.write_text(to_toml(CONFIG))
    return str(path)


def call(program, arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["program", *arguments])
    return program.main()


def refused(code: int, captured) -> str:
    """Return the sentence of a refusal after checking its form."""
    assert code == 2
    assert not captured.out
    lines = [line for line in captured.err.splitlines() if not line.startswith(STARTS)]
    assert len(lines) == 1, captured.err
    assert lines[0].startswith("error: ")
    assert lines[0].endswith((".", "?"))
    return lines[0]


def test_infer_writes_what_evaluate_reads(tmp_path: Path, model, clip, monkeypatch, capsys):
    out = str(tmp_path / "pred.h5")
    assert call(infer, [model, "--motion", clip, "--out", out, "--preroll", "12"], monkeypatch) == 0
    assert f"{out}: 18 frames in " in capsys.readouterr().out
    with open_sequence(out) as made, open_sequence(clip) as truth:
        assert made.frames == 18
        collision = {name for name in made.extra_names if name.startswith("collision_")}
        assert {"collision_deepest_after_mm", "collision_outcome", "collision_pop_mm"} <= collision
        assert set(made.extra_names) - collision == {"outside_training_range"}
        assert made.read_extra("collision_deepest_after_mm", 0, 18).shape == (18,)
        pins = SCENE.pins
        assert pins is not None
        # the truth's pins are skinned with the same weights; files hold 16 bits
        np.testing.assert_allclose(
            made.read(0, 18)[:, pins.vertices], truth.read(0, 18)[:, pins.vertices], atol=2e-4
        )
    assert garment_jax(["evaluate", out, clip, "--every", "6"]) == 0
    assert [line.split()[3] for line in capsys.readouterr().out.splitlines()[:3:2]] == ["polka", "18"]
    assert garment_jax(["info", out]) == 0
    assert "predicted" in capsys.readouterr().out


def test_infer_leaves_stages_out(tmp_path: Path, model, clip, monkeypatch):
    made = []
    for name, words in (("bare", ["--no-detail"]), ("full", []), ("short", ["--no-lengths"])):
        out = str(tmp_path / f"{name}.h5")
        assert (
            call(infer, [model, "--motion", clip, "--out", out, "--no-collision", *words], monkeypatch) == 0
        )
        with open_sequence(out) as sequence:
            made.append(sequence.read(0, 18))
    assert np.abs(made[0] - made[1]).max() > 1e-3
    assert np.abs(made[2] - made[1]).max() > 1e-3


def test_infer_refuses_in_a_sentence(tmp_path: Path, model, clip, monkeypatch, capsys):
    out = str(tmp_path / "pred.h5")
    other = str(write_clip(tmp_path / "other.h5", 4, scene=make_scene(7, 16)))
    fast = str(write_clip(tmp_path / "fast.h5", motion=make_motion(SCENE, 4, fps=60.0)))
    cut = tmp_path / "cut.h5"
    cut.write_bytes(Path(clip).read_bytes()[:3000])
    for words, sentence in (
        (["nowhere", "--motion", clip, "--out", out], "there is no model nowhere; name a folder, or"),
        ([model, "--motion", "nowhere.h5", "--out", out], "is not there"),
        ([model, "--motion", str(cut), "--out", out], "cut.h5"),
        ([model, "--motion", other, "--out", out], "112 vertices and the model was trained on 128"),
        ([model, "--motion", fast, "--out", out], "60 fps and the model was trained at 30"),
        ([model, "--motion", clip, "--out", clip], "holds the motion itself"),
        ([model, "--motion", clip, "--out", other], "other.h5 is there already; --force replaces it"),
        ([model, "--motion", clip, "--out", "."], ". is a folder; name a sequence file"),
        (["nowhere", "--motion", clip, "--out", ".", "--budget-ms", "1"], ". is a folder; name a sequence"),
        ([model, "--motion", clip, "--out", "a" * 300], "is a name of 300 bytes, more than 255"),
        ([model, "--motion", clip, "--out", out, "--preroll", "-1"], "--preroll -1 is negative"),
    ):
        assert sentence in refused(call(infer, words, monkeypatch), capsys.readouterr())
    assert not Path(out).exists()


def without_fps(path: str) -> None:
    with h5py.File(path, "r+") as file:
        del file.attrs["fps"]


def not_a_number(path: str) -> None:
    with h5py.File(path, "r+") as file:
        file["vertices"][2, 5, 0] = np.nan


def short(path: str) -> None:
    Path(path).write_bytes(Path(path).read_bytes()[:-3000])


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (without_fps, "fps"),
        (not_a_number, "waltz.h5: vertex 5 of frame 2 is"),
        (short, "waltz.h5"),
    ],
)
def test_train_refuses_spoilt_clips(tmp_path: Path, config, monkeypatch, capsys, spoil, sentence):
    path = write_clip(tmp_path / "data" / "waltz.h5", 6, scene=SCENE, encoding="float32")
    spoil(str(path))
    words = [
        config,
        "--data",
        str(tmp_path / "data"),
        "--run-dir",
        str(tmp_path / "run"),
        "--data.validation",
        "",
    ]
    assert sentence in refused(call(train, words, monkeypatch), capsys.readouterr())


def test_train_refuses_what_it_is_asked(tmp_path: Path, config, monkeypatch, capsys):
    run, data = str(tmp_path / "run"), str(tmp_path / "data")
    (tmp_path / "data").mkdir()
    prepare_run(tmp_path / "used", CONFIG)
    broken = tmp_path / "broken.toml"
    broken.write_text("[motion]\ngrue = 3\n")
    for words, sentence in (
        (["nowhere.toml"], "No configuration file 'nowhere.toml'"),
        ([str(broken)], "unknown key in [motion] 'grue'"),
        ([config, "--motion.grue", "3"], "Did you mean 'gru'?"),
        ([config[:-7] + "tinny.toml"], "tiny.toml?"),
        ([str(tmp_path)], "is a folder; name a configuration in it"),
        ([config, "--detail.gru", "3"], "Did you mean 'motion.gru'?"),
        ([config, "--motion.gru", "wide"], "motion.gru = 'wide' must be a whole number"),
        (
            [config, "--stage", "sewing"],
            "--stage 'sewing' is unknown; choose all, generative, motion, detail",
        ),
        ([config, "--run-dir", run, "--stage", "motion"], "holds no finished generative stage"),
        ([config, "--run-dir", run, "--data", data], "holds no training clips"),
    ):
        assert sentence in refused(call(train, words, monkeypatch), capsys.readouterr())
    assert not (tmp_path / "run" / "config.toml").exists()


def test_train_refuses_a_run_of_another_configuration(tmp_path: Path, config, monkeypatch, capsys):
    write_clip(tmp_path / "data" / "waltz.h5", 6, scene=SCENE)
    words = [
        config,
        "--data",
        str(tmp_path / "data"),
        "--data.validation",
        "",
        "--run-dir",
        str(tmp_path / "run"),
    ]
    prepare_run(tmp_path / "run", CONFIG)
    said = refused(call(train, words, monkeypatch), capsys.readouterr())
    assert "belongs to another run (data.validation = ['waltz_3'], not []); use another --run-dir" in said


@pytest.mark.parametrize("program", ["train.py", "infer.py"])
def test_help_is_quick_and_needs_no_jax(program: str):
    words = (
        "import sys, runpy\n"
        f"sys.argv = ['{program}', '--help']\n"
        f"try: runpy.run_path('{program}', run_name='__main__')\n"
        "except SystemExit as stop: assert not stop.code\n"
        "assert 'jax' not in sys.modules"
    )
    result = subprocess.run(
        [sys.executable, "-c", words], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert result.returncode == 0, result.stderr
    assert "--motion" in result.stdout


def started(model: str, clip: str, out: str, *words: str, cache: str = "off") -> set[str]:
    """Run infer.py in a fresh interpreter; return the modules that it had imported at the end."""
    code = (
        "import sys, infer\n"
        f"sys.argv = ['infer.py', {model!r}, '--motion', {clip!r}, '--out', {out!r}, *{list(words)!r}]\n"
        "assert infer.main() == 0\n"
        "print('MODULES', *sys.modules)"
    )
    environment = {**os.environ, "GARMENT_JAX_CACHE": cache}
    if cache != "off":  # what the tests' own cache hands out is not kept
        del environment["JAX_COMPILATION_CACHE_DIR"]
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
        env=environment,
    )
    assert result.returncode == 0, result.stderr
    assert "Warning" not in result.stderr
    return set(result.stdout.split("MODULES")[1].split())


def test_what_is_off_is_not_imported(tmp_path: Path, model, clip):
    bare = started(model, clip, str(tmp_path / "a.h5"), "--no-collision", "--no-detail")
    heavy = {"garment_jax.model.detail.network", "garment_jax.training.checkpoint"}
    assert not bare & (heavy | {"optax", "orbax.checkpoint", "matplotlib", "trimesh", "warp"})
    fine = started(model, clip, str(tmp_path / "b.h5"), "--no-collision", cache=str(tmp_path / "cache"))
    assert "garment_jax.model.detail.network" in fine
    assert len(list((tmp_path / "cache" / "programs").glob("rollout-*.program"))) == 1
    assert not list((tmp_path / "cache" / "programs").glob("contacts*"))  # the solver is not even compiled


def test_a_cache_that_cannot_be_written_breaks_nothing(tmp_path: Path, model, clip):
    (tmp_path / "file").write_text("")
    out = tmp_path / "out.h5"
    started(model, clip, str(out), "--no-collision", "--no-detail", cache=str(tmp_path / "file" / "below"))
    assert out.exists()


@pytest.fixture
def quick_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """Times as if measured: no test depends on a clock."""

    def measured(model, scene, motion, variant, *, store=None) -> float:
        return 1.0 + 0.5 * variant.detail + 4.0 * variant.collision

    monkeypatch.setattr("garment_jax.animation.calibration.measured_ms", measured)
    monkeypatch.setenv("GARMENT_JAX_CACHE", "off")


def test_a_run_stopped_between_its_stages_says_how_to_go_on(config: str, tmp_path: Path, monkeypatch, capsys):
    def stopped(*_, **__) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("garment_jax.training.pipeline.train", stopped)
    assert call(train, [config, "--data", str(tmp_path)], monkeypatch) == 130
    assert capsys.readouterr().err.endswith("\ninterrupted; the same command goes on\n")


def test_the_plan_alone_writes_nothing(model, clip, monkeypatch, capsys, quick_times):
    words = [model, "--motion", clip, "--plan", "--no-detail"]
    assert call(infer, words, monkeypatch) == 0
    said = capsys.readouterr().out
    assert "detail off saves 0.50 not wanted" in " ".join(said.split())
    assert "triangles can ever be reached" in said
    assert "estimate: 5.0 ms a frame, 0.1 s for 18 frames; what is left out saves 0.5 ms a frame" in said


def test_a_budget_chooses_a_measured_variant(tmp_path: Path, clip, monkeypatch, capsys, quick_times):
    folder, out = save_model(tiny_model(), tmp_path / "model"), str(tmp_path / "out.h5")
    words = [str(folder), "--motion", clip, "--out", out, "--budget-ms"]
    assert "variants.json is missing" in refused(call(infer, [*words, "4"], monkeypatch), capsys.readouterr())
    rows = [
        {
            "name": name,
            "settings": variants_of(tiny_model().params)[name]._asdict(),
            "error_cm": error,
            "ms": 99.0,
        }
        for name, error in (("whole", 1.0), ("no collision", 1.1), ("no collision, no detail", 1.2))
    ]
    (folder / "variants.json").write_text(json.dumps({"variants": rows, "detail_mm": 0.4}))
    assert call(infer, [*words, "4"], monkeypatch) == 0
    said = capsys.readouterr().out
    assert "budget 4 ms: no collision, 1.5 ms a frame here, error 1.10 cm" in said
    assert "whole model 1.00 cm, 5.5 ms" in said
    with open_sequence(out) as made:
        assert made.extra_names == ("outside_training_range",)
    sentence = refused(call(infer, [*words, "0.5", "--force"], monkeypatch), capsys.readouterr())
    assert "the fastest, 'no collision, no detail', takes 1.0 ms a frame" in sentence
    assert call(infer, [*words[:-1], "--no-collision", "--lod", "2", "--plan", "--force"], monkeypatch) == 0
    assert "too fine to see: it moves the cloth by 0.4 mm, a pixel covers 2 mm" in capsys.readouterr().out


def test_a_budget_without_the_column_rnn_chooses_among_variants_without(
    tmp_path: Path, clip, monkeypatch, capsys, quick_times
):
    folder, out = save_model(column_rnn_model(), tmp_path / "model"), str(tmp_path / "out.h5")
    rows = [
        {"name": name, "settings": VARIANTS[name]._asdict(), "error_cm": error, "ms": 99.0}
        for name, error in (("whole", 1.0), ("no column RNN", 1.1), ("latents alone", 1.2))
    ]
    (folder / "variants.json").write_text(json.dumps({"variants": rows, "detail_mm": 0.4}))
    words = [str(folder), "--motion", clip, "--out", out, "--budget-ms"]
    assert call(infer, [*words, "9"], monkeypatch) == 0
    assert "budget 9 ms: whole," in capsys.readouterr().out
    assert call(infer, [*words, "9", "--no-column-rnn", "--plan", "--force"], monkeypatch) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "budget 9 ms: no column RNN," in said
    assert "column_rnn off - not wanted: latents alone move the cloth" in said
    # the third variant would leave collisions unhandled
    asked = [*words, "9", "--no-column-rnn", "--no-detail", "--force"]
    sentence = refused(call(infer, asked, monkeypatch), capsys.readouterr())
    assert "no variant without just the column RNN and detail has been measured" in sentence


def test_one_motion_must_be_named(model, clip, monkeypatch, capsys):
    for words in ([model], [model, clip, "--motion", clip]):
        said = refused(call(infer, words, monkeypatch), capsys.readouterr())
        assert "infer takes one motion: name a sequence file" in said


def test_a_prediction_is_named_after_its_motion(tmp_path: Path, model, clip, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("garment_jax.cli.infer_command.infer", lambda **given: [given["out"]])
    assert call(infer, [model, clip], monkeypatch) == 0
    assert capsys.readouterr().out.splitlines()[0] == "polka_pred.h5"


def test_training_and_inference_are_commands_too(config, tmp_path: Path, model, clip, monkeypatch, capsys):
    seen = {}
    monkeypatch.setattr(
        "garment_jax.training.pipeline.train", lambda _, run, **given: seen.update(given, run=run) or run
    )
    words = ["train", "--motion.steps=7", config, "--generative.steps", "5", "--out", "here"]
    assert garment_jax(words) == 0
    assert (seen["run"], seen["stage"]) == ("here", "all")
    monkeypatch.setattr("garment_jax.cli.infer_command.infer", lambda **given: [given["motion"]])
    assert garment_jax(["infer", model, clip]) == 0
    assert clip in capsys.readouterr().out
