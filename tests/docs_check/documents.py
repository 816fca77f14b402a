"""The commands and the Python of the documents, taken out of them by file and line."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
DOCUMENTS = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")))
PROGRAMS = ("garment-jax", "train.py", "infer.py", "make")
_PYTHON = re.compile(r"^(?:\.venv/bin/)?python\d?$")
_SPAN = re.compile(r"`([^`\n]+)`")
_ENDS = {"&&", "||", ";", "|", ">", "2>", ">>"}  # of a command within a line


class Command(NamedTuple):
    """One command of a document."""

    place: str  # file:line
    line: str  # as it stands
    words: tuple[str, ...]  # the program first, without python and folders before it
    whole: bool  # of a block; one within a sentence may leave out what every call needs


class Block(NamedTuple):
    """One block of Python."""

    place: str
    text: str


def commands(document: Path) -> Iterator[Command]:
    """Yield the commands of a document's blocks and sentences, in their order."""
    for number, line, language in lines(document):
        place = f"{document.relative_to(ROOT)}:{number}"
        if language is None:
            found = [(span, False) for span in _SPAN.findall(line)]
        else:
            found = [] if language == "python" else [(line, True)]
        for text, whole in found:
            for words in split(text):
                yield Command(place, text.strip(), words, whole)


def blocks(document: Path) -> Iterator[Block]:
    """Yield the blocks of Python."""
    text, first = [], 0
    for number, line, language in lines(document):
        if language == "python":
            text, first = [*text, line], first or number
        elif text:
            yield Block(f"{document.relative_to(ROOT)}:{first}", "\n".join(text))
            text, first = [], 0


def lines(document: Path) -> Iterator[tuple[int, str, str | None]]:
    """Yield number, text and language of each line: "" in a block without one, None outside of blocks."""
    language, held, began = None, "", 0
    for number, line in enumerate(document.read_text(encoding="utf-8").splitlines(), 1):
        if line.startswith("```"):
            language = None if language is not None else line[3:].strip()
            yield number, "", None  # keeps two blocks apart
        elif language != "python" and line.endswith("\\"):
            held, began = f"{held}{line[:-1]} ", began or number
        else:
            indented = language is None and line.startswith("    ") and not held
            yield began or number, held + line, "" if indented else language
            held, began = "", 0


def split(line: str) -> Iterator[tuple[str, ...]]:
    """Yield the commands of a line that are this project's, without comments, settings and `python`."""
    try:
        words = shlex.split(line, comments=True)
    except ValueError:  # an apostrophe in a sentence
        return
    command: list[str] = []
    for word in [*words, ";"]:
        if word not in _ENDS:
            command.append(word)
            continue
        while command and (_PYTHON.match(command[0]) or re.match(r"^[A-Z_]+=", command[0])):
            command = command[1:]
        if command and (name := command[0].removeprefix(".venv/bin/")) in PROGRAMS:
            yield (name, *command[1:])
        elif command[:2] == ["-m", "garment_jax"]:
            yield ("garment-jax", *command[2:])
        command = []
