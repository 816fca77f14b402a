"""The page of the first frames: it looks at its own file until that leads to the finished page."""

from pathlib import Path

import pytest

from garment_jax.api import early_page
from garment_jax.api.early_page import EarlyPage
from tests.reference.scene import write_clip


@pytest.fixture
def no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(early_page, "SECONDS", 0)


def test_it_plays_the_frames_and_gives_way_to_the_finished_page(tmp_path: Path, no_waiting):
    seen: list[str] = []
    page = EarlyPage(tmp_path, "a <b>", body=True, show=lambda path: seen.append(path.read_text()) or True)
    write_clip(page.sequence, frames=3)
    page()
    (text,) = seen
    assert text.index('http-equiv="refresh" content="0"') < 2000
    assert "a &lt;b&gt;: first frames, still without contact handling" in text
    assert 'content="garment-jax view"' in text
    finished = tmp_path / 'walk & "run".html'
    page.give_way(finished)
    left = page.path.read_text()
    assert 'content="0; url=file:///' in left
    assert "walk%20%26%20%22run%22.html" in left


def test_a_page_that_nobody_opened_gives_way_to_none(tmp_path: Path):
    page = EarlyPage(tmp_path, "walk", body=False, show=lambda path: False)
    write_clip(page.sequence, frames=3)
    page()
    before = page.path.read_bytes()
    page.give_way(tmp_path / "walk.html")
    assert page.path.read_bytes() == before
