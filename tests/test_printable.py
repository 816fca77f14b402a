"""What is printed shows as text on any terminal, and one bad file leaves the others of a command alone."""

import os
import subprocess
import sys
from pathlib import Path

import h5py
import pytest

from garment_jax.cli import FAULT, info, main
from garment_jax.cli.printable import printable
from tests.io.packed import write_packed
from tests.reference.scene import write_clip

ROOT = Path(__file__).parents[1]


def run(*arguments: str | bytes, **environment: str) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "garment_jax", *arguments]
    return subprocess.run(command, capture_output=True, env=os.environ | environment, cwd=ROOT, check=False)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain é …\n\tend\n", "plain é …\n\tend\n"),
        ("\x1b[2J\x07bell\x9b", "\\x1b[2J\\x07bell\\x9b"),
        ("\rprogress\r\n", "\rprogress\r\n"),
        ("a\rb", "a\\rb"),
        ("\u202egnp.exe", "\\u202egnp.exe"),
    ],
)
def test_control_codes_are_spelt_out(text: str, shown: str):
    assert printable(text) == shown


def closed_pipe() -> int:
    """Return a descriptor to write to that nobody reads."""
    reading, writing = os.pipe()
    os.close(reading)
    return writing


@pytest.mark.parametrize("name", ["stdout", "stderr"])
def test_work_goes_on_where_nobody_reads_and_the_exit_code_is_its_own(tmp_path: Path, name: str):
    sources = [write_packed(tmp_path, f"train_{clip}", 3) for clip in "ab"]
    bad = write_clip(tmp_path / "bad.h5", 3)
    bad.write_bytes(bad.read_bytes()[:5000])
    for words, code in ((["import", *sources, "--out", str(tmp_path / "out")], 0), (["validate", bad], 1)):
        pipe = closed_pipe()
        command = [sys.executable, "-m", "garment_jax", *map(str, words)]
        others = {"stdout", "stderr"} - {name}
        streams = {name: pipe} | dict.fromkeys(others, subprocess.PIPE)
        done = subprocess.run(command, cwd=ROOT, check=False, text=True, **streams)
        os.close(pipe)
        assert done.returncode == code, done
        assert name == "stderr" or "Broken" not in done.stderr
    assert sorted(path.name for path in (tmp_path / "out" / "train").iterdir()) == ["a.h5", "b.h5"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_under_standard_output_is_said(tmp_path: Path):
    clip = str(write_clip(tmp_path / "clip.h5", 2))
    for words in (["info", clip], ["--help"]):
        with open("/dev/full", "w") as full:
            command = [sys.executable, "-m", "garment_jax", *words]
            done = subprocess.run(
                command, stdout=full, stderr=subprocess.PIPE, cwd=ROOT, check=False, text=True
            )
        assert done.returncode == 2
        assert done.stderr == (
            "error: standard output was not written (No space left on device); send it elsewhere.\n"
        )
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "garment_jax", "info", "nowhere.h5"]
        assert subprocess.run(command, stderr=full, cwd=ROOT, check=False).returncode == 2


def test_a_notebooks_backend_does_not_stop_pictures(tmp_path: Path):
    clip = str(write_clip(tmp_path / "clip.h5", 2))
    words = ["render", clip, "--out", str(tmp_path / "out"), "--frames", "1", "--height", "60"]
    done = run(*words, MPLBACKEND="module://nowhere")
    assert done.returncode == 0, done.stderr
    assert done.stderr.startswith(b"render: " + os.fsencode(clip) + b" -> ")


def test_names_from_files_are_printed_as_text(tmp_path: Path):
    clip = write_clip(tmp_path / "clip.h5", 2)
    with h5py.File(clip, "r+") as file:
        file.attrs["name"] = "\x1b]0;title\x07\x1b[31m"
    done = run("info", str(clip))
    assert done.returncode == 0
    assert b"\x1b" not in done.stdout
    assert b"\\x1b]0;title\\x07\\x1b[31m" in done.stdout


def test_a_name_that_is_no_utf_8(tmp_path: Path):
    name = os.fsencode(tmp_path) + b"/caf\xe9\x1b.h5"
    os.rename(write_clip(tmp_path / "clip.h5", 2), name)
    done = run("info", name, PYTHONIOENCODING="utf-8")
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"caf\\udce9\\x1b.h5" in done.stdout


@pytest.mark.parametrize("environment", [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONUTF8": "0"}])
def test_help_in_an_ascii_terminal(environment: dict[str, str]):
    done = run("simulate", "embedded", "--help", **environment)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"--vertices" in done.stdout


@pytest.mark.parametrize("command", ["import", "collide", "evaluate"])
def test_out_through_a_circle_of_links(tmp_path: Path, command: str, capsys):
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    clip = str(write_clip(tmp_path / "clip.h5", 2))
    inputs = [clip, clip] if command == "evaluate" else [clip]
    assert main([command, *inputs, "--out", str(tmp_path / "a" / "x.json")]) == 2
    assert "is a link that leads back to itself; name another place" in capsys.readouterr().err


def test_one_bad_file_of_three(tmp_path: Path, capsys):
    clips = [str(write_clip(tmp_path / f"{name}.h5", 2)) for name in "abc"]
    Path(clips[1]).write_bytes(Path(clips[1]).read_bytes()[:5000])
    assert main(["info", *clips]) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert f"{clips[1]} is truncated" in captured.err
    assert clips[0] in captured.out
    assert clips[2] in captured.out
    (tmp_path / "truth").mkdir()
    for name in "ac":
        write_clip(tmp_path / "truth" / f"{name}.h5", 2)
    Path(tmp_path / "truth" / "b.h5").write_bytes(b"nothing")
    assert main(["evaluate", str(tmp_path), str(tmp_path / "truth")]) == 2
    captured = capsys.readouterr()
    assert "error: left out: b.h5; the reasons are above." in captured.err
    assert main(["render", str(tmp_path), str(tmp_path / "truth"), "--out", str(tmp_path / "out")]) == 2
    captured = capsys.readouterr()
    assert "error: left out: b.h5; the reasons are above." in captured.err
    assert len(captured.out.splitlines()) >= 2  # of a.h5 and c.h5


def test_a_surprise_while_reading_is_that_files(tmp_path: Path, capsys, monkeypatch):
    clips = [str(write_clip(tmp_path / f"{name}.h5", 2)) for name in "ab"]
    real = info._describe

    def fails(path: Path) -> dict:
        return {}["heap"] if path.name == "a.h5" else real(path)

    monkeypatch.setattr(info, "_describe", fails)
    assert main(["info", *clips]) == 2
    captured = capsys.readouterr()
    assert captured.err == f"error: {clips[0]} is damaged: KeyError 'heap'; copy or export it again.\n"
    assert clips[1] in captured.out


def test_a_fault_of_ours_is_no_faults_found(monkeypatch, capsys):
    def fails(options: object) -> int:
        raise LookupError("ours")

    monkeypatch.setattr(info, "run", fails)
    assert main(["info", "a.h5"]) == FAULT
    assert "LookupError: ours" in capsys.readouterr().err
