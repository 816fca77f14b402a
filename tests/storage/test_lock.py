"""One process at a time in a folder; the second is told who is there."""

import errno
import fcntl
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from garment_jax.storage.lock import lock_name, locked
from garment_jax.storage.processes import this_process

CHILD = (
    "import sys; from pathlib import Path; from garment_jax.storage.lock import locked\n"
    "with locked(Path(sys.argv[1]), 'training'): print('held', flush=True); sys.stdin.read()"
)


@pytest.fixture
def holder(tmp_path: Path):
    """A process that holds the folder."""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
    )
    assert child.stdout is not None
    assert child.stdout.readline() == b"held\n"
    yield child
    child.kill()
    child.communicate()


def test_the_second_is_told_who_is_there_and_what_to_do(tmp_path: Path, holder: subprocess.Popen) -> None:
    sentence = (
        rf"^process {holder.pid} on \S+ is training in {tmp_path} since .*; wait until it ends, or use a"
    )
    with pytest.raises(OSError, match=sentence), locked(tmp_path, "saving", remedy="use another"):
        pass
    holder.communicate(b"")
    with locked(tmp_path, "saving"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_killed_holder_holds_nothing(tmp_path: Path, holder: subprocess.Popen) -> None:
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    assert (tmp_path / ".lock").is_file()
    with locked(tmp_path, "training"):
        assert json.loads((tmp_path / ".lock").read_text())["pid"] == os.getpid()
    assert list(tmp_path.iterdir()) == []


def test_clips_of_one_folder_are_held_one_by_one(tmp_path: Path) -> None:
    with locked(tmp_path, "a", name=lock_name("a")):
        with locked(tmp_path, "b", name=lock_name("b")):
            assert len(list(tmp_path.iterdir())) == 2
        with pytest.raises(OSError, match="is a in"), locked(tmp_path, "a", name=lock_name("a")):
            pass
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_was_made_for_nothing_goes_again(tmp_path: Path) -> None:
    with pytest.raises(KeyError), locked(tmp_path / "new" / "run", "training"):
        raise KeyError
    assert list(tmp_path.iterdir()) == []
    with locked(tmp_path / "new" / "run", "training"):
        (tmp_path / "new" / "run" / "log").touch()
    assert (tmp_path / "new" / "run" / "log").exists()


def test_a_link_in_the_way_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / ".lock").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="cannot be worked in"), locked(tmp_path, "training"):
        pass
    assert not (tmp_path / "elsewhere").exists()


def test_where_the_file_system_knows_no_locks_the_file_decides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unknown(*_: object) -> None:
        raise OSError(errno.ENOTSUP, "not supported")

    monkeypatch.setattr(fcntl, "flock", unknown)
    this = this_process()._asdict()
    for facts, held in (
        (this | {"host": "elsewhere_1"}, True),
        (this | {"pid": os.getppid(), "started": 1}, False),  # a number that is another process' now
        (this | {"pid": 2**22 + 1}, False),
    ):
        (tmp_path / ".lock").write_text(json.dumps({**facts, "doing": "training", "since": "today"}))
        if held:
            with pytest.raises(OSError, match=r"or delete .*\.lock if it has"), locked(tmp_path, "x"):
                pass
        else:
            with locked(tmp_path, "x"):
                pass
