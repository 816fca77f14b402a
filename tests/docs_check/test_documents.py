"""Every command of README and docs is one that the parser takes; every block of Python names what exists."""

import ast
import re
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from garment_jax.cli import infer_command, make_parser, train
from garment_jax.cli.parser import Parser
from garment_jax.config import apply_overrides, load_config
from tests.docs_check.documents import DOCUMENTS, ROOT, Block, Command, blocks, commands, split

MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
TARGETS = set(re.findall(r"^([a-z-]+):", MAKEFILE, re.M))
VARIABLES = set(re.findall(r"^([A-Z]+) [?:]?=|\$\(([A-Z]+)\)", MAKEFILE, re.M))
COMMANDS = [command for document in DOCUMENTS for command in commands(document)]
WRONG = ("garment-jax exprt", "garment-jax info a --fast", "make dance", "train.py configs/no.toml")
BLOCKS = [block for document in DOCUMENTS for block in blocks(document)]


class Refused(Exception):
    """What a parser says of a line."""


def meant(words: Sequence[str]) -> list[str]:
    """The words of a line as somebody types them: of `[--eps MM]` and `usd|glb` one of what is meant."""
    synopsis = any(word.startswith("[") for word in words)
    typed = []
    for word in words:
        word = word.strip("[]").removesuffix("...").removesuffix("…").split("|")[0]
        typed.append("1" if synopsis and re.fullmatch("[A-Z]+", word) else word)
    return [word for word, before in zip(typed, words, strict=True) if word or not before]


@cache
def parser_of(program: str) -> Parser:
    if program == "garment-jax":
        return make_parser()
    parser = Parser(prog=program)
    {"train.py": train, "infer.py": infer_command}[program].add_arguments(parser)
    return parser


def parse(words: Sequence[str]) -> None:
    """Parse a command as its program does; `Refused` for one that it does not take."""
    name, *rest = words
    if name == "make":
        known = {name for pair in VARIABLES for name in pair}
        wrong = [w for w in rest if w not in TARGETS and w.partition("=")[0] not in known]
        if wrong:
            raise Refused(f"make has no {wrong[0]}")
        return
    found = parser_of(name).parse_args(rest)
    config = str(getattr(found, "config", ""))
    if config.startswith("configs/") and not (ROOT / config).is_file():
        raise Refused(f"there is no {config}")
    if getattr(found, "overrides", None):
        apply_overrides(load_config(ROOT / "configs/skirt.toml"), found.overrides)


@pytest.fixture
def refusing(monkeypatch: pytest.MonkeyPatch) -> None:
    def error(self: Parser, message: str) -> None:
        raise Refused(message)

    monkeypatch.setattr(Parser, "error", error)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_commands_in_documents_are_taken(document: Path, refusing) -> None:
    said = [(command, fault(command)) for command in commands(document)]
    wrong = [f"{command.place}: {command.line}: {found}" for command, found in said if found]
    assert not wrong, "\n".join(wrong)


def fault(command: Command) -> str:
    """What the parser says of a command; "" where it takes it; in a sentence it may be short."""
    words = meant(command.words)
    if words[1:] in ([], ["COMMAND"]):
        return ""
    try:
        parse(words)
    except Refused as refused:
        short = not command.whole and re.search("are required|expected .*argument", str(refused))
        return "" if short else str(refused)
    return ""


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.place)
def test_what_python_in_documents_imports_is_there(block: Block) -> None:
    for node in ast.walk(ast.parse(block.text)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("garment_jax"):
            for name in node.names:
                assert hasattr(import_module(node.module or ""), name.name), f"{block.place}: {name.name}"


def test_examples_in_help_are_taken(refusing) -> None:
    parsers, without = [make_parser()], set()
    while parsers:
        parser = parsers.pop()
        for action in parser._subparsers._group_actions if parser._subparsers else []:
            parsers += action.choices.values()  # type: ignore[union-attr]
        lines, seen = (parser.epilog or "").splitlines(), 0
        for line in lines:
            for words in split(re.split(r"\s{3,}", line.strip())[0]):
                parse(meant(words))
                seen += 1
        without |= set() if seen else {parser.prog}
    assert without == {"garment-jax"}  # which names a command to begin with


def test_the_documents_are_read_whole() -> None:
    programs = [command.words[0] for command in COMMANDS if command.whole]
    assert programs.count("garment-jax") > 30
    assert programs.count("train.py") > 5
    assert len(BLOCKS) > 5


def test_a_command_is_taken_out_of_its_line() -> None:
    line = 'X=1 .venv/bin/python train.py a.toml --data.validation "" && garment-jax info b.h5 | head  # c'
    assert list(split(line)) == [
        ("train.py", "a.toml", "--data.validation", ""),
        ("garment-jax", "info", "b.h5"),
    ]
    assert meant(["collide", "S.h5", "[--eps", "MM]", "--f", "usd|glb", "…"]) == [
        *("collide", "S.h5", "--eps", "1", "--f", "usd")
    ]


@pytest.mark.parametrize("words", WRONG)
def test_a_wrong_command_is_found(words: str, refusing) -> None:
    with pytest.raises(Refused):
        parse(words.split())
