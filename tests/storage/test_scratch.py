"""Scratch folders: of one process, swept when it has ended, left alone while it lives."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from garment_jax.storage import processes
from garment_jax.storage.processes import is_dead, this_process
from garment_jax.storage.scratch import make_scratch, scratch, sweep, unmade

CHILD = "import sys; from pathlib import Path; from garment_jax.storage.scratch import make_scratch; "
CHILD += "print(make_scratch(Path(sys.argv[1])), flush=True); sys.stdin.read()"


def other_process(folder: Path) -> tuple[subprocess.Popen, Path]:
    """Return a process that has made a scratch folder and waits."""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
    )
    assert child.stdout is not None
    return child, Path(child.stdout.readline().decode().strip())


def test_what_a_killed_process_left_goes_and_what_a_living_one_has_stays(tmp_path: Path) -> None:
    child, made = other_process(tmp_path)
    try:
        (made / "half").write_text("x")
        sweep(tmp_path)
        assert (made / "half").is_file()
        child.send_signal(signal.SIGKILL)
        while child.poll() is None:  # a process that has ended but was not asked for counts as dead, too
            sweep(tmp_path)
    finally:
        child.communicate()
    with scratch(tmp_path):
        assert not made.exists()
    assert list(tmp_path.iterdir()) == []


def test_a_number_that_is_another_process_now_is_dead_and_other_machines_are_not_judged() -> None:
    this = this_process()
    assert not is_dead(this)
    assert is_dead(this._replace(started=this.started - 1))
    assert is_dead(this._replace(pid=2**22 + 1))
    assert not is_dead(this._replace(pid=2**22 + 1, host="elsewhere_1"))


def test_names_that_only_look_alike_stay(tmp_path: Path) -> None:
    names = (
        ".saving.1",
        "1-2-x-0123456789abcdef.partial",
        ".1-2-x-012.partial",
        "clip.partial",
        "28.partial",
    )
    for name in names:
        (tmp_path / name).mkdir()
    sweep(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)


def test_a_planted_link_of_a_dead_process_name_is_not_followed(tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "letter").write_text("dear")
    host = this_process().host
    (tmp_path / f".{2**22 + 1}-1-{host}-0123456789abcdef.partial").symlink_to(kept)
    sweep(tmp_path)
    assert (kept / "letter").read_text() == "dear"


def test_nobody_else_may_look_in_and_no_name_comes_twice(tmp_path: Path) -> None:
    made = {make_scratch(tmp_path) for _ in range(20)}
    assert len(made) == 20
    assert {path.stat().st_mode & 0o777 for path in made} == {0o700}


def test_without_a_process_table_numbers_alone_decide(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes.Path, "exists", lambda path: False)
    assert not is_dead(this_process()._replace(started=0))
    assert is_dead(this_process()._replace(pid=2**22 + 1))


def test_folders_made_for_what_failed_are_removed_and_others_stay(tmp_path: Path) -> None:
    for kept in ((), ("out",), ("out/train",), ("out/other.h5",)):
        base = tmp_path / str(len(kept)) / "-".join(kept).replace("/", "_")
        base.mkdir(parents=True)
        for name in kept:
            (base / name).mkdir(parents=True)
        before = sorted(base.rglob("*"))
        with suppress(ValueError), unmade(base / "out/train"):
            (base / "out/train").mkdir(parents=True, exist_ok=True)
            raise ValueError
        assert sorted(base.rglob("*")) == before
    with unmade(tmp_path / "new/train"):
        (tmp_path / "new/train").mkdir(parents=True)
    assert (tmp_path / "new/train").is_dir()
