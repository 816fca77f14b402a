"""Finding Blender and running scripts in it, with stand-ins that say how they were called."""

import os
import sys
from pathlib import Path

import pytest

from garment_jax.io.formats.blender import VARIABLE, find_blender, run_blender

pytestmark = pytest.mark.skipif(os.name == "nt", reason="stand-ins are shell scripts")


def stand_in(path: Path, lines: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{lines}\n")
    path.chmod(0o755)
    return path


def test_the_argument_comes_before_the_variable_before_the_path(tmp_path: Path, monkeypatch):
    on_path = stand_in(tmp_path / "bin" / "blender", "")
    monkeypatch.setenv("PATH", str(on_path.parent))
    monkeypatch.delenv(VARIABLE, raising=False)
    assert find_blender() == on_path
    named = stand_in(tmp_path / "other", "")
    monkeypatch.setenv(VARIABLE, str(named))
    assert find_blender() == named
    assert find_blender(on_path) == on_path


def test_no_blender_is_one_sentence_with_the_remedy(tmp_path: Path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(FileNotFoundError, match=r"which is not here; install Blender .*pip install bpy"):
        find_blender()
    with pytest.raises(FileNotFoundError, match=r"^nowhere is no program; install Blender"):
        find_blender("nowhere")
    monkeypatch.setenv(VARIABLE, "/nowhere/blender")
    with pytest.raises(FileNotFoundError, match=r"^GARMENT_JAX_BLENDER=/nowhere/blender is no program"):
        find_blender()
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name)
    monkeypatch.delenv(VARIABLE)
    assert find_blender() == Path(sys.executable)


def test_an_executable_and_a_python_are_called_differently(tmp_path: Path):
    blender = stand_in(tmp_path / "blender-4.5", 'echo "$@"')
    said = run_blender("script.py", ["job"], blender=blender).split()
    assert said == ["--background", "--factory-startup", "--python-exit-code", "1", "--python"] + [
        "script.py",
        "--",
        "job",
    ]
    python = stand_in(tmp_path / "python3.11", 'echo "$@"')
    assert run_blender("script.py", ["job"], blender=python).split() == ["-I", "script.py", "--", "job"]


@pytest.mark.parametrize(
    ("lines", "kind", "sentence"),
    [
        ("echo 'refused: a.abc has holes' >&2; echo more >&2; exit 1", ValueError, "^a.abc has holes$"),
        (
            "echo \"No module named 'bpy'\" >&2; exit 1",
            FileNotFoundError,
            "has no module",
        ),
        ("echo first >&2; echo last >&2; exit 3", OSError, r"failed \(exit code 3\): last"),
        ("exit 4", OSError, r"failed \(exit code 4\): nothing said"),
    ],
)
def test_failures_are_one_sentence(tmp_path: Path, lines: str, kind: type, sentence: str):
    with pytest.raises(kind, match=sentence):
        run_blender("script.py", [], blender=stand_in(tmp_path / "blender", lines))


def test_a_reader_that_hangs_is_ended(tmp_path: Path):
    with pytest.raises(TimeoutError, match=r"took more than 0\.1 s and was ended"):
        run_blender("script.py", [], blender=stand_in(tmp_path / "blender", "exec sleep 30"), seconds=0.1)
