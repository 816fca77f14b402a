"""A page of the first frames, shown while contact handling is still being compiled."""

import html
import time
from collections.abc import Callable
from pathlib import Path

SECONDS = 2  # between two looks of the page at its own file


class EarlyPage:
    """A page in the scratch folder that gives way to the finished one."""

    def __init__(self, place: Path, title: str, *, body: bool, show: Callable[[Path], bool]) -> None:
        self.sequence, self.path = place / "first-frames.h5", place / "first-frames.html"
        self._title, self._body, self._show, self._open = title, body, show, False

    def __call__(self) -> None:
        """Write the page of the frames in `sequence` and show it."""
        from garment_jax.viewer.command import view_files

        title = f"{self._title}: first frames, still without contact handling"
        view_files([self.sequence], self.path, title=title, body=self._body)
        _reloading(self.path, f"{SECONDS}")
        self._open = self._show(self.path)

    def give_way(self, page: Path) -> None:
        """Let the page that is open become the finished one."""
        if self._open:
            url = html.escape(page.resolve().as_uri())
            self.path.write_text("<!doctype html><meta charset=utf-8>\n", encoding="utf-8")
            _reloading(self.path, f"0; url={url}")
            time.sleep(SECONDS + 0.5)  # until it has looked


def _reloading(page: Path, content: str) -> None:
    text = page.read_text(encoding="utf-8")
    mark = text.index(">", text.index("<meta charset")) + 1
    page.write_text(
        f'{text[:mark]}<meta http-equiv="refresh" content="{content}">{text[mark:]}', encoding="utf-8"
    )
