"""Output appears when it is whole, or not at all."""

import errno
import sys
from pathlib import Path

import pytest

from garment_jax.storage.whole import link_or_copy, written_whole


def test_files_take_their_names_together_at_the_end(tmp_path: Path):
    targets = [tmp_path / "new" / name for name in ("a.pc2", "a.obj")]
    with written_whole(*targets) as (first, second):
        assert (first.name, first.parent.parent) == ("a.pc2", tmp_path / "new")
        first.write_text("1")
        second.write_text("2")
        assert not targets[0].exists()
    assert [path.read_text() for path in targets] == ["1", "2"]
    assert len(list((tmp_path / "new").iterdir())) == 2


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_nothing_is_left_and_older_files_stay(tmp_path: Path, error: type):
    (tmp_path / "a").write_text("old")
    with pytest.raises(error):  # noqa: PT012, SIM117
        with written_whole(tmp_path / "a", tmp_path / "folder") as (file, folder):
            file.write_text("new")
            folder.mkdir()
            (folder / "x").touch()
            raise error
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert (tmp_path / "a").read_text() == "old"


def test_a_full_disk_is_one_sentence(tmp_path: Path):
    with pytest.raises(OSError, match=r"a could not be written \(No space left .*; nothing was saved"):  # noqa: SIM117
        with written_whole(tmp_path / "a"):
            raise OSError(errno.ENOSPC, "No space left on device")


def test_a_folder_that_holds_something_is_not_replaced(tmp_path: Path):
    (tmp_path / "out").mkdir()
    with written_whole(tmp_path / "out") as (folder,):
        folder.mkdir()
        (folder / "x").touch()
    assert (tmp_path / "out" / "x").exists()
    with pytest.raises(OSError, match="out is a folder that is not empty"):  # noqa: SIM117
        with written_whole(tmp_path / "out"):
            pass


def test_a_set_is_never_a_mixture_at_whatever_move_it_stops(tmp_path: Path):
    """The cache is there only beside the mesh that was written with it."""
    cache, mesh, stale = (tmp_path / name for name in ("a.pc2", "a.obj", "a.swing"))
    seen = []

    def texts() -> tuple[str | None, ...]:
        return tuple(path.read_text() if path.exists() else None for path in (cache, mesh, stale))

    def look(event: str, _: object) -> None:
        if event in ("os.rename", "os.remove") and watching:
            seen.append(texts())

    for path in (cache, mesh, stale):
        path.write_text("old")
    watching = True
    sys.addaudithook(look)
    try:
        with written_whole(cache, mesh, last=[cache], gone=[stale]) as made:
            for path in made:
                path.write_text("new")
    finally:
        watching = False
    seen.append(texts())
    states = list(dict.fromkeys(seen))
    assert states[0] == ("old", "old", "old")
    assert states[-1] == ("new", "new", None)
    assert all(state[0] is None for state in states[1:-1])
    assert len(states) == 5


def test_a_folder_that_fills_up_meanwhile_stays(tmp_path: Path):
    with pytest.raises(OSError, match=r"out was filled by another process meanwhile; name a new one"):  # noqa: PT012, SIM117
        with written_whole(tmp_path / "out") as (folder,):
            folder.mkdir()
            (tmp_path / "out").mkdir()
            (tmp_path / "out" / "theirs").touch()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_files_are_moved_into_place_in_one_room() -> None:
    package = Path(__file__).parents[2] / "garment_jax"
    own_order = {
        "model/folder.py",
        "training/checkpoint.py",
    }  # several moves that a reader tells apart
    movers = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if "os.replace(" in path.read_text(encoding="utf-8")
    }
    assert movers == own_order | {"storage/whole.py"}


@pytest.mark.parametrize("links", [True, False])
def test_a_file_gets_another_name_or_a_copy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, links: bool
) -> None:
    (tmp_path / "a").write_text("whole")
    if not links:

        def refused(*_: object) -> None:
            raise PermissionError(errno.EPERM, "no hard links here")

        monkeypatch.setattr("os.link", refused)
    link_or_copy(tmp_path / "a", tmp_path / "b")
    assert (tmp_path / "b").read_text() == "whole"
    assert ((tmp_path / "a").stat().st_ino == (tmp_path / "b").stat().st_ino) == links
