"""Signals that ask a command to end: nothing is left half written, the exit code is theirs, none is lost."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BEGIN = """
import gc, os, signal, sys, time
from argparse import Namespace
from pathlib import Path
import garment_jax.cli as cli
from garment_jax.cli import exit
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # and those of nohup this one
exit.listen()
"""


def run(code: str, folder: Path, *, begin: str = BEGIN) -> tuple[int, str, str]:
    """Run code as a program in `folder`; return its exit code, stdout and stderr."""
    program = f"import sys; sys.path[:0] = [{str(ROOT)!r}, {str(folder)!r}]\n{begin}\n{code}"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, timeout=60, check=False
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_a_signal_leaves_nothing_half_written(tmp_path: Path, name: str, code: int):
    ended = run(
        f"""
from garment_jax.storage.scratch import scratch
def work(options):
    with scratch(Path("out")):
        signal.raise_signal(signal.{name})
        time.sleep(50)
exit.leave(cli.carry_out(Namespace(run=work)))
""",
        tmp_path,
    )
    assert ended == (code, "", "interrupted\n")
    assert list((tmp_path / "out").iterdir()) == []


def test_a_signal_that_is_lost_comes_again(tmp_path: Path):
    ended = run(
        """
class Closing:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)
def work(options):
    Closing()
    time.sleep(50)
exit.leave(cli.carry_out(Namespace(run=work)))
""",
        tmp_path,
    )
    assert ended == (130, "", "interrupted\n")


def test_a_signal_waits_for_an_import_in_the_middle_of_work(tmp_path: Path):
    (tmp_path / "slow.py").write_text("import signal\nsignal.raise_signal(signal.SIGTERM)\nwhole = True\n")
    ended = run(
        """
def work(options):
    import slow
    print(slow.whole, flush=True)
    time.sleep(50)
exit.leave(cli.carry_out(Namespace(run=work)))
""",
        tmp_path,
    )
    assert ended == (143, "True\n", "interrupted\n")


def test_while_a_command_imports_what_it_uses_a_signal_ends_at_once(tmp_path: Path):
    (tmp_path / "slow.py").write_text("import signal\nsignal.raise_signal(signal.SIGTERM)\nprint('on')\n")
    code = "exec(compile('import slow', str(Path(cli.__file__).with_name('collide.py')), 'exec'))"
    assert run(code, tmp_path) == (143, "", "interrupted\n")


def test_before_the_commands_are_there_ctrl_c_ends_at_once(tmp_path: Path):
    begin = """
import signal
from garment_jax.__main__ import begin
signal.signal(signal.SIGINT, signal.default_int_handler)
class Slow:
    def find_spec(name, path, target=None):
        if name == "garment_jax.cli":
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Slow)
"""
    assert run("begin()", tmp_path, begin=begin) == (130, "", "interrupted\n")


def test_what_fails_of_a_signal_is_no_fault(tmp_path: Path):
    ended = run(
        """
def work(options):
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt as error:
        raise RuntimeError("a callback was broken off") from error
exit.leave(cli.carry_out(Namespace(run=work, stopped="interrupted; nothing was written")))
""",
        tmp_path,
    )
    assert ended == (130, "", "interrupted; nothing was written\n")


@pytest.mark.parametrize(("one", "out"), [(0.0, "first\n"), (100.0, "first\non\n")])
def test_a_second_signal_ends_at_once_unless_it_comes_with_the_first(tmp_path: Path, one: float, out: str):
    ended = run(
        f"""
exit._ONE = {one}
try:
    signal.raise_signal(signal.SIGINT)
except KeyboardInterrupt:
    print("first", flush=True)
signal.raise_signal(signal.SIGINT)
print("on", flush=True)
exit.leave(130)
""",
        tmp_path,
    )
    assert ended == (130, out, "")


def test_an_ignored_signal_stays_so(tmp_path: Path):
    code = """
signal.signal(signal.SIGHUP, signal.SIG_IGN)
exit.listen()
signal.raise_signal(signal.SIGHUP)
exit.leave(exit.stopped())
"""
    assert run(code, tmp_path) == (0, "", "")


def test_workers_are_asked_too_where_a_terminal_does_not(tmp_path: Path):
    (tmp_path / "jobs.py").write_text(
        """
import time
from pathlib import Path

def nothing():
    pass

def wait(_, job):
    try:
        Path(job).touch()
        time.sleep(100)
    finally:
        Path(job).unlink()
"""
    )
    (tmp_path / "start.py").write_text(
        f"""
import os, signal, sys, threading, time
from pathlib import Path
sys.path[:0] = [{str(ROOT)!r}, {str(tmp_path)!r}]
from argparse import Namespace
import garment_jax.cli as cli
from garment_jax.cli import exit
from garment_jax.farm.local import LocalFarm
from garment_jax.farm.work import Work
import jobs

def work(options):
    list(LocalFarm(2).map(Work(jobs.nothing, jobs.wait), {{"a": "a", "b": "b"}}))

def stop():
    while not (Path("a").exists() and Path("b").exists()):
        time.sleep(0.1)
    os.kill(os.getpid(), signal.SIGTERM)

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    exit.listen()
    threading.Thread(target=stop, daemon=True).start()
    exit.leave(cli.carry_out(Namespace(run=work)))
"""
    )
    started = [sys.executable, str(tmp_path / "start.py")]
    done = subprocess.run(started, cwd=tmp_path, capture_output=True, text=True, timeout=90, check=False)
    assert (done.returncode, done.stdout) == (143, ""), done.stderr
    assert not (tmp_path / "a").exists()
    assert not (tmp_path / "b").exists()
