"""The `garment-jax` command: commands run, refusals are one sentence and exit code 2."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from garment_jax.cli import GROUPS, main, make_parser
from garment_jax.cli.next_step import say_next
from garment_jax.io.sequence import open_sequence
from garment_jax.model.store import save_model
from tests.animation.tiny_model import tiny_model
from tests.io.packed import write_packed
from tests.reference.scene import write_clip

ROOT = Path(__file__).parents[1]


def test_import_then_info(tmp_path: Path, capsys):
    write_packed(tmp_path, "test_waltz", 5)
    out = tmp_path / "out"
    assert main(["import", str(tmp_path / "skirt"), "--out", str(out)]) == 0
    assert "1 clips, 5 frames, 1 of them imported now" in capsys.readouterr().out
    assert main(["info", str(out / "test/waltz.h5"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)[str(out / "test/waltz.h5")]
    assert (facts["frames"], facts["split"]) == (5, "test")
    assert main(["info", str(out / "test/waltz.h5")]) == 0
    assert "waltz" in capsys.readouterr().out


def test_info_tells_of_a_model_and_of_what_else_can_be_read(tmp_path: Path, capsys):
    model = save_model(tiny_model(), tmp_path / "model")
    clip = write_clip(tmp_path / "clip.h5", 2)
    assert main(["info", "--json", "nowhere.h5", str(model), str(clip)]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("error: nowhere.h5 is not there")
    facts = json.loads(captured.out)
    assert facts[str(model)]["model"] == {
        "vertices": 128,
        "fps": 30.0,
        "parts": ["detail", "generative", "motion"],
    }
    assert facts[str(clip)]["frames"] == 2
    (model / "parameters.npz").write_text("no zip")
    assert main(["info", str(model)]) == 2
    assert "model holds a damaged model" in capsys.readouterr().err


def test_evaluate_never_writes_over_what_it_reads(tmp_path: Path, capsys):
    path = write_clip(tmp_path / "p.h5", 6)
    before = path.read_bytes()
    (tmp_path / "folder").mkdir()
    for out, words in ((path, "is what is read"), (tmp_path / "folder", "is a folder")):
        assert main(["evaluate", str(path), str(path), "--out", str(out)]) == 2
        assert words in capsys.readouterr().err
    assert path.read_bytes() == before


def test_evaluate_replaces_figures_with_force_alone(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_clip("p.h5", 6)
    words = ["evaluate", "p.h5", "p.h5", "--every", "6", "--out"]
    for name, reason in (
        ("a.json", "a.json is there already; --force"),
        ("b.obj", "end in .json"),
    ):
        Path(name).write_text("mine")
        assert main([*words, name]) == 2
        assert reason in capsys.readouterr().err
        assert Path(name).read_text() == "mine"
    assert main([*words, "a" * 300 + ".json"]) == 2
    assert "is a name of 305 bytes, more than 255; give a shorter one." in capsys.readouterr().err
    assert main([*words, "a.json", "--force"]) == 0
    assert json.loads(Path("a.json").read_text())["frames"] == 6
    assert main([*words, "c.json", "--curves", "c.jpg"]) == 2
    assert "--curves c.jpg does not end in .png" in capsys.readouterr().err
    assert not Path("c.json").exists()
    assert main([*words, "c.json", "--again", "p.h5", "--curves", "c.png"]) == 0
    assert Path("c.png").read_bytes().startswith(b"\x89PNG")


def test_a_second_simulation_does_not_replace_the_first(tmp_path: Path, capsys):
    path = write_clip(tmp_path / "p.h5", 6)
    before = path.read_bytes()
    assert main(["floor", str(path), "--out", str(path)]) == 2
    assert "p.h5 is the clip itself; write to another file." in capsys.readouterr().err
    assert path.read_bytes() == before


def test_evaluate_prints_a_table_or_json(tmp_path: Path, capsys):
    for part in ("pred", "truth"):
        (tmp_path / part).mkdir()
    pred, truth = (str(write_clip(tmp_path / part / "clip.h5", 6)) for part in ("pred", "truth"))
    assert main(["evaluate", pred, truth]) == 0
    clip, _, frames, *_ = capsys.readouterr().out.splitlines()
    cells = [[cell.strip() for cell in line.split("|")[1:3]] for line in (clip, frames)]
    assert cells == [["clip", "clip"], ["frames", "6"]]
    assert main(["evaluate", pred, truth, "--json", "--every", "3", "--out", str(tmp_path / "f.json")]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["metrics"]["rmse_cm"] == 0
    assert json.loads((tmp_path / "f.json").read_text()) == figures
    assert main(["evaluate", str(tmp_path / "pred"), str(tmp_path / "truth"), "--json"]) == 0
    assert [clip["clip"] for clip in json.loads(capsys.readouterr().out)] == ["clip"]


def test_collide_writes_a_sequence_and_says_what_it_did(tmp_path: Path, capsys):
    clip, out = str(write_clip(tmp_path / "clip.h5", 3)), str(tmp_path / "out.h5")
    assert main(["collide", clip, "--out", out, "--eps", "2", "--iterations", "20"]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith(f"{out}: 3 frames, ")
    assert "largest pop" in first
    with open_sequence(out) as made:
        assert made.attributes["collision_eps_m"] == 0.002
    assert main(["evaluate", out, clip, "--whole-body"]) == 0
    assert "arms inside %" in capsys.readouterr().out


def test_a_stopped_collide_says_so_and_leaves_nothing(tmp_path: Path, capsys, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    clip = str(write_clip(tmp_path / "clip.h5", 3))
    monkeypatch.setattr("garment_jax.animation.collide._resolved", stop)
    assert main(["collide", clip, "--out", str(tmp_path / "out.h5")]) == 130
    assert "interrupted" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["clip.h5"]


def test_render_writes_pictures_and_names_them(tmp_path: Path, capsys):
    clip = str(write_clip(tmp_path / "clip.h5", 3))
    out = tmp_path / "pictures"
    assert main(["render", clip, "--out", str(out), "--frames", "2", "--height", "80"]) == 0
    written = capsys.readouterr().out.split()
    assert written == [str(out / "clip_sheet.png")]
    assert Path(written[0]).stat().st_size > 1_000


def test_an_output_has_a_name_where_none_is_given(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_clip("clip.h5", 3)
    for words in (["collide"], ["view"], ["export", "--format", "npz"], ["render", "--height", "80"]):
        assert main([words[0], "clip.h5", *words[1:]]) == 0
    made = {"clip_collided.h5", "clip.html", "clip.npz", "pictures"}
    assert {path.name for path in tmp_path.iterdir()} == {"clip.h5", *made}
    assert "next: garment-jax view clip.h5 clip_collided.h5" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["info", "nowhere.h5"], "is not there"),
        (["import", "nowhere.h5", "--out", "out"], "is not there"),
        (["evaluate", "nowhere.h5", "nowhere.h5"], "is not there"),
        (["evaluate", ".", "nowhere.h5"], "a file and a folder"),
        (["render", ".", "--out", "o"], ". is a folder; give the path of an HDF5 file"),
        (["evaluate", ".", "."], "holds no predictions"),
        (["render", "nowhere.h5", "--out", "o"], "is not there"),
        (["render", "a.h5", "b.h5", "c.h5", "--out", "o"], "not 3 paths"),
        (["info", "."], "neither a run nor a model"),
        (["collide", "nowhere.h5", "--out", "o.h5"], "is not there"),
        (["collide", "a.h5", "--out", "./a.h5"], "a.h5 is what is read"),
        (["collide", "a.h5", "--out", "."], ". is a folder; name a sequence file"),
        (["collide", "a.h5", "--out", "o.obj"], "--out o.obj does not end in .h5"),
        (["collide", "a.h5", "--out", "o.h5", "--eps", "-1"], "--eps -1 mm is out of range"),
    ],
)
def test_refusals_are_a_sentence_and_exit_code_2(tmp_path, monkeypatch, capsys, arguments, sentence):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert sentence in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("dance", "there is no command 'dance'; choose of animate, view, "),
        ("exprt", "there is no command 'exprt'; did you mean export?"),
        ("--versoin", "garment-jax has no option --versoin; did you mean --version?"),
        ("animate skirt --no-colision", "animate has no option --no-colision; did you mean --no-collision?"),
        ("simulate --embeded skirt", "simulate has no option --embeded; did you mean embedded?"),
        ("animate skirt --format gbl", "--format gbl is no choice; did you mean glb?"),
        ("simulate embedded sirt --out o", "GARMENT sirt is no choice; did you mean skirt?"),
        (
            "animate skirt --out x.glb walk.bvh",
            "no use for 'walk.bvh' there; inputs come first, then options;",
        ),
        ("train", "garment-jax train needs CONFIG; garment-jax train --help shows how."),
        ("train a.toml --tensorbord", "has no option --tensorbord; did you mean --tensorboard?"),
        ("animate", "error: garment-jax animate needs model; garment-jax animate --help shows how."),
        ("learn trousers", "GARMENT trousers is no choice; choose of skirt, circle_skirt, dress, cape;"),
        (
            "collide a.h5 --eps 0.004m",
            "--eps 0.004m is no number (distance to keep, millimetres, such as 4; ",
        ),
        (
            "export a.h5 --every 1.5",
            "--every 1.5 is no whole number (glb: every so many frames becomes a morph target); ",
        ),
    ],
)
def test_a_wrong_word_is_answered_in_a_sentence_with_the_right_one(words: str, sentence: str, capsys):
    with pytest.raises(SystemExit) as stop:
        main(words.split())
    assert stop.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert sentence in error


def test_commands_stand_in_groups_one_line_each(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line in GROUPS] == ["use", "make", "research"]
    after = lines[lines.index("make") :]
    assert after[1].startswith("  learn      make a model")
    assert max(map(len, lines)) <= 110


def test_module_runs_and_help_needs_no_jax():
    command = (
        "import sys, runpy\n"
        "sys.argv = ['garment-jax', '--help']\n"
        "try: runpy.run_module('garment_jax', run_name='__main__')\n"
        "except SystemExit as stop: assert not stop.code\n"
        "assert not {'jax', 'h5py', 'numpy'} & set(sys.modules)"
    )
    result = subprocess.run(
        [sys.executable, "-c", command], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert result.returncode == 0, result.stderr
    for name in ("import", "info", "collide", "evaluate", "render"):
        assert name in result.stdout


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("export p.h5 --out f/p.glb", "export: p.h5 -> f/p.glb"),
        ("collide p.h5", "collide: p.h5"),
        ("evaluate p.h5 t.h5 --json", "evaluate: p.h5 t.h5"),
        ("simulate embedded skirt --out d", "simulate embedded: skirt -> d"),
        ("import a b c d e --out d", "import: a b c and 2 more -> d"),
        ("info p.h5", ""),  # quick
        ("train demo", ""),  # has a line of its own
    ],
)
def test_the_first_line_names_inputs_and_output(words: str, line: str):
    assert make_parser().parse_args(words.split()).begins == line


def test_a_device_that_is_not_here_is_the_users_choice(monkeypatch, capsys):
    def absent(*_: object) -> None:
        raise RuntimeError("Unable to initialize backend")

    monkeypatch.setenv("JAX_PLATFORMS", "tpu")
    monkeypatch.setattr("jax.devices", absent)
    monkeypatch.setattr("garment_jax.cli.info.run", lambda options: {}["no device"])
    assert main(["info", "a.h5"]) == 2
    assert capsys.readouterr().err == (
        "error: JAX_PLATFORMS=tpu names a device that is not here; unset it, or set it to cpu.\n"
    )


def test_the_next_command_takes_a_name_that_begins_with_a_dash(capsys):
    say_next("view", Path("-x.h5"), "--out", Path("a/-y.html"), "-z")
    assert capsys.readouterr().err == "next: garment-jax view ./-x.h5 --out a/-y.html -z\n"


@pytest.mark.parametrize("code", [130, 2, 0])
def test_an_interrupted_program_ends_at_once_whatever_its_threads_do(code: int) -> None:
    lines = (
        "import threading, time",
        "from garment_jax.cli.exit import leave",
        f"threading.Thread(target=time.sleep, args=({60 if code == 130 else 0},)).start()",
        "print('said')",
        f"leave({code})",
    )
    ended = subprocess.run(
        [sys.executable, "-c", "\n".join(lines)], capture_output=True, timeout=50, text=True
    )
    assert (ended.returncode, ended.stdout) == (code, "said\n")


def test_figures_are_saved_whoever_stops_reading(tmp_path: Path, monkeypatch) -> None:
    clip = write_clip(tmp_path / "clip.h5", 4)
    out = tmp_path / "figures.json"

    def gone(*_words, **_options) -> None:
        raise BrokenPipeError

    monkeypatch.setattr("builtins.print", gone)
    options = make_parser().parse_args(["evaluate", str(clip), str(clip), "--out", str(out)])
    with pytest.raises(BrokenPipeError):
        options.run(options)
    assert json.loads(out.read_text())["metrics"]["rmse_cm"] == 0


def test_a_tilde_is_the_home_folder_wherever_a_shell_left_it(tmp_path: Path, monkeypatch, capsys):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    write_clip(tmp_path / "a.h5", 3)
    assert main(["export", "~/a.h5", "--out=~/made/a.npz", "--unit", "m"]) == 0
    assert main(["export", "~/a.h5", "--out", "~/b.npz"]) == 0
    assert (tmp_path / "made/a.npz").is_file()
    assert (tmp_path / "b.npz").is_file()
    options = make_parser().parse_args(["train", "demo", "--data.dir=~/clips", "--run-dir", "a~b"])
    assert options.overrides == [f"--data.dir={tmp_path}/clips"]
    assert str(options.run_dir) == "a~b"
