"""Wavefront OBJ's text, one statement at a time: every reader of OBJ files goes by this.

A line that ends in a backslash goes on in the next one, whatever the line's end is; a comment reaches from
"#" to the end of its line; a byte-order mark is read over.
"""

from collections.abc import Iterator
from pathlib import Path

from garment_jax.io.formats.limits import LONGEST_NUMBER, check_size

LARGEST = 96 * 2**20  # bytes of a file; a garment of 100,000 vertices has about 15 MB
_LONGEST = 2**20  # characters of a statement: a polygon of 50,000 corners
_LONGEST_INDEX = 9  # characters: more vertices than any file that is read can hold
_NAMES = ("g", "o", "usemtl", "mtllib")  # keywords that names follow
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")


def read_statements(path: str | Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of its first line, from 1, and the words of every statement, the keyword first.

    Raises `FileNotFoundError`, or `ValueError` for a file that is too large, one of 16-bit characters, and
    a statement that is too long to be one.
    """
    path = Path(path)
    check_size(path, LARGEST, "an OBJ file")
    with path.open("rb") as raw:
        if raw.read(2) in _UTF_16:
            raise ValueError(f"{path} is written in 16-bit characters; save it as UTF-8.")
    held: list[str] = []
    first = length = 0
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(file, 1):
            text = line.rstrip()
            if "#" in text:
                text = _without_comment(text)
            goes_on = text.endswith("\\")
            if not (goes_on or held):
                words = text.split() if len(text) <= _LONGEST else []
                if words:
                    yield number, words
                elif text:
                    raise ValueError(_too_long(path, number))
                continue
            first, length = first or number, length + len(text)
            if length > _LONGEST:
                raise ValueError(_too_long(path, first))
            held.append(text.removesuffix("\\"))
            if not goes_on:
                words = " ".join(held).split()
                if words:
                    yield first, words
                held, first, length = [], 0, 0
    if words := " ".join(held).split():
        yield first, words


def number_of(word: str) -> float:
    """Return the number that a word is; `ValueError` for what is none or too long for one."""
    if len(word) > LONGEST_NUMBER or "_" in word:
        raise ValueError
    return float(word)


def index_of(word: str, size: int) -> int:
    """Return the index, from 0, that a word names where `size` things stand before it, -1 for none.

    OBJ counts from 1, or back from the last one; whether so many come at all the reader knows at the end.
    """
    if len(word) > _LONGEST_INDEX or "_" in word:
        return -1
    try:
        number = int(word)
    except ValueError:
        return -1
    return number - 1 if number > 0 else size + number if -size <= number < 0 else -1


def shown(words: list[str]) -> str:
    """Return words for a sentence, cut where they are many or long."""
    return repr(" ".join(word[:40] for word in words[:8]))


def _without_comment(text: str) -> str:
    at = text.find("#")
    if text.lstrip().split(None, 1)[0] in _NAMES:  # a name may hold one, not begin with it
        while at > 0 and not text[at - 1].isspace():
            at = text.find("#", at + 1)
    return text if at < 0 else text[:at].rstrip()


def _too_long(path: Path, line: int) -> str:
    return f"{path} line {line} has over {_LONGEST} characters; the file is damaged, export it again."
