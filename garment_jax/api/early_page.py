"""A page of the first frames, shown while contact handling is still being compiled."""

import html
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from garment_jax.storage.whole import write_text

SECONDS = 2  # between two looks of the page at its own file
KEPT = 4  # pages in the folder: a browser may still be busy when the command has ended


class EarlyPage:
    """A page that gives way to the finished one; `folder`, the cache's, goes on leading there.

    A disk that takes no page spoils nothing: the animation is somewhere else.
    """

    def __init__(
        self, place: Path, folder: Path, title: str, *, body: bool, show: Callable[[Path], bool]
    ) -> None:
        self.sequence = place / "first-frames.h5"  # in the scratch folder `place`
        self.path = folder / f"first-frames-{os.getpid()}.html"
        self._title, self._body, self._show, self._open = title, body, show, False

    def __call__(self) -> None:
        """Write the page of the frames in `sequence` and show it."""
        with suppress(OSError):
            self._make()
            self._open = self._show(self.path)

    def _make(self) -> None:
        from garment_jax.viewer.command import view_files

        for old in sorted(self.path.parent.glob("first-frames-*.html"), key=os.path.getmtime)[: 1 - KEPT]:
            old.unlink(missing_ok=True)
        title = f"{self._title}: first frames, still without contact handling"
        made = self.sequence.with_suffix(".html")
        view_files([self.sequence], made, title=title, body=self._body)
        self._write(made.read_text(encoding="utf-8"), f"{SECONDS}")

    def give_way(self, page: Path) -> None:
        """Let the page that is open become the finished one."""
        if self._open:
            url = html.escape(page.resolve().as_uri())
            with suppress(OSError):
                self._write("<!doctype html><meta charset=utf-8>\n", f"0; url={url}")

    def _write(self, text: str, refresh: str) -> None:
        mark = text.index(">", text.index("<meta charset")) + 1
        write_text(self.path, f'{text[:mark]}<meta http-equiv="refresh" content="{refresh}">{text[mark:]}')
