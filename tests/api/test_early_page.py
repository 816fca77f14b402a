"""The page of the first frames: it looks at its own file until that leads to the finished page."""

from pathlib import Path

from garment_jax.api.early_page import KEPT, EarlyPage
from tests.reference.scene import write_clip


def test_it_plays_the_frames_and_gives_way_to_the_finished_page(tmp_path: Path):
    seen: list[str] = []
    folder = tmp_path / "cache"
    folder.mkdir()
    for k in range(KEPT + 2):
        (folder / f"first-frames-0{k}.html").touch()
    show = lambda path: seen.append(path.read_text()) or True  # noqa: E731
    page = EarlyPage(tmp_path, folder, "a <b>", body=True, show=show)
    write_clip(page.sequence, frames=3)
    page()
    (text,) = seen
    assert text.index('http-equiv="refresh" content="2"') < 2000
    assert "a &lt;b&gt;: first frames, still without contact handling" in text
    assert 'content="garment-jax view"' in text
    assert len(list(folder.iterdir())) == KEPT
    page.give_way(tmp_path / 'walk & "run".html')
    left = page.path.read_text()
    assert 'content="0; url=file:///' in left
    assert "walk%20%26%20%22run%22.html" in left
    assert len(left) < 500


def test_a_page_that_nobody_opened_gives_way_to_none(tmp_path: Path):
    page = EarlyPage(tmp_path, tmp_path, "walk", body=False, show=lambda path: False)
    write_clip(page.sequence, frames=3)
    page()
    before = page.path.read_bytes()
    page.give_way(tmp_path / "walk.html")
    assert page.path.read_bytes() == before


def test_a_folder_that_takes_no_page_spoils_nothing(tmp_path: Path):
    shown: list[Path] = []
    page = EarlyPage(
        tmp_path, tmp_path / "gone", "walk", body=False, show=lambda path: not shown.append(path)
    )
    (tmp_path / "gone").touch()
    write_clip(page.sequence, frames=3)
    page()
    page.give_way(tmp_path / "walk.html")
    assert not shown
