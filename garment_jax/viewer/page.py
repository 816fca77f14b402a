"""The page: template, style and scripts of this package, and blocks of data, in one HTML file."""

import html
import json
from collections.abc import Callable
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

from garment_jax.storage.whole import Unfinished
from garment_jax.viewer.payload import as_text

# In the order in which they stand in the page; they share one scope.
SCRIPTS = (
    "decode",
    "measure",
    "surface",
    "materials",
    "figures",
    "stage",
    "curve",
    "player",
    "panel",
    "main",
)


class PageWriter:
    """Writes a page block by block; use it in a `with` statement.

    The file is built in a scratch folder and moved into place at the end; on any error nothing is left.
    """

    def __init__(self, path: str | Path, title: str) -> None:
        self.path = Path(path)
        self._title = title
        self._blocks = 0

    def add(self, data: bytes) -> str:
        """Write a block of bytes and return the id by which the page finds it."""
        name = f"block-{self._blocks}"
        self._blocks += 1
        text = as_text(data)
        self._write(lambda file: file.write(f'<script type="text/plain" id="{name}">{text}</script>\n'))
        return name

    def finish(self, facts: dict[str, Any]) -> None:
        """Write what the page shall know and its scripts; the page is then whole."""
        self._write(lambda file: file.write(_facts(facts) + _scripts() + self._tail))

    def __enter__(self) -> "PageWriter":
        head, self._tail = _template(self._title)
        try:
            self._unfinished = Unfinished(self.path)
            self._file = open(self._unfinished.path, "w", encoding="utf-8")
        except OSError as error:
            raise OSError(f"{self.path} could not be written ({error.strerror}).") from error
        try:
            self._write(lambda file: file.write(head))
        except BaseException:
            self._discard()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self._discard()
            return
        try:
            self._write(lambda file: file.close())
            self._unfinished.move()
        finally:
            self._discard()

    def _write(self, action: Callable[[TextIO], object]) -> None:
        try:
            action(self._file)
        except OSError as error:
            raise OSError(
                f"{self.path} could not be written ({error.strerror}); nothing was saved, free some space or "
                "choose another folder."
            ) from error

    def _discard(self) -> None:
        with suppress(OSError):  # what cannot be written is deleted anyway
            self._file.close()
        self._unfinished.discard()


def in_html(text: str) -> str:
    """Return text that shows as it is, as an element's content or an attribute's value."""
    return html.escape(text, quote=True)


def in_script(value: Any) -> str:
    """Return JSON that can stand in a script element whatever the names in it are."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _template(title: str) -> tuple[str, str]:
    head, tail = _own("page.html").split("<!-- data and scripts -->")
    # The title comes last: it may look like any of the marks.
    head = head.replace("/* style */", _own("style.css")).replace("{{title}}", in_html(title))
    return head, tail


def _facts(facts: dict[str, Any]) -> str:
    return f'<script type="application/json" id="facts">{in_script(facts)}</script>\n'


def _scripts() -> str:
    ours = "\n".join(_own("script", f"{name}.js") for name in SCRIPTS)
    return f'<script>{_own("three.bundle.js")}</script>\n<script type="module">\n{ours}</script>\n'


def _own(*parts: str) -> str:
    """Return one of the files that lie beside this one."""
    return files("garment_jax.viewer").joinpath(*parts).read_text(encoding="utf-8")
