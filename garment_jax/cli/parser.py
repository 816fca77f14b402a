"""The parser of every command: an example in its help, and a wrong word answered with the right one."""

import argparse
import difflib
import os
import sys
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn


class Help(argparse.RawDescriptionHelpFormatter):
    """Lines of examples stay as they are; a text of one line is wrapped."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return super()._fill_text(text if "\n" in text else textwrap.fill(text, width), width, indent)


class Parser(argparse.ArgumentParser):
    """`ArgumentParser` that refuses in one sentence and names what was probably meant.

    A parser with the default `overrides` also takes `--SECTION.KEY VALUE`, as a list of words there.
    """

    def __init__(self, **given: Any) -> None:
        super().__init__(**{"formatter_class": Help, **given})

    def parse_known_args(self, args=None, namespace=None):
        """Parse all words; none is left over, and `~` at a path's beginning is the home folder."""
        words, overrides = list(map(at_home, sys.argv[1:] if args is None else args)), []
        if self.get_default("overrides") is not None:
            words, overrides = split_overrides(words)
        self._refuse_unknown(words)
        found, left = super().parse_known_args(words, namespace)
        if left:
            self.error(f"{self.prog} has no use for {left[0]!r} there; inputs come first, then options")
        if overrides:
            found.overrides = overrides  # type: ignore[union-attr]
        if "begins" not in found:  # a subparser's stays
            found.begins = self._first_line(found)  # type: ignore[union-attr]
        return found, left

    def _first_line(self, found: argparse.Namespace) -> str:
        """Return the command with its inputs and `--out`: "export: walk.h5 -> walk.glb"."""
        read: list[str] = []
        for action in self._get_positional_actions():
            value = getattr(found, action.dest, None)
            read += map(str, value if isinstance(value, list) else [] if value is None else [value])
        more = f" and {len(read) - 3} more" if len(read) > 3 else ""
        out = getattr(found, "out", None)
        into = "" if out is None else f" -> {out}"
        return f"{self.prog.removeprefix('garment-jax ')}: {' '.join(read[:3])}{more}{into}"

    def error(self, message: str) -> NoReturn:
        """End with the sentence and exit code 2."""
        message = message.replace("the following arguments are required:", f"{self.prog} needs")
        end = "" if message.endswith("?") else f"; {self.prog} --help shows how."
        self.exit(2, f"error: {message}{end}\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        known = [str(choice) for choice in action.choices]
        meant = near(str(value), known, say=f"choose of {', '.join(known)}")
        if isinstance(action, argparse._SubParsersAction):
            self.error(f"there is no {str(action.metavar).lower()} {value!r}; {meant}")
        self.error(f"{_called(action)} {value} is no choice; {meant}")

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        try:
            return super()._get_value(action, arg_string)
        except argparse.ArgumentError:
            if action.type not in (int, float):
                raise
            number = "whole number" if action.type is int else "number"
            self.error(f"{_called(action)} {arg_string} is no {number} ({action.help})")

    def _refuse_unknown(self, words: Sequence[str]) -> None:
        """Refuse the first option that there is not, before anything is said of what is missing."""
        below = [a for a in self._actions if isinstance(a, argparse._SubParsersAction)]
        for word in words:
            if word == "--" or (below and not word.startswith("-")):
                return  # values follow; or a subcommand, which has options of its own
            name = word.partition("=")[0]
            if not name.startswith("--") or " " in word or self._has(name):
                continue
            shown = [s for a in self._actions if a.help != argparse.SUPPRESS for s in a.option_strings]
            known = [*shown, *(choice for action in below for choice in action.choices)]
            hint = near(name, known)
            self.error(f"{self.prog} has no option {name}{hint and '; '}{hint}")

    def _has(self, name: str) -> bool:
        options = self._option_string_actions
        return name in options or any(option.startswith(name) for option in options)


def at_home(word: str) -> str:
    """Return a word with `~` at its beginning as the home folder; shells leave --OPTION=~/PATH as it is."""
    option, equals, value = word.partition("=")
    return option + equals + os.path.expanduser(value) if option[:2] == "--" else os.path.expanduser(word)


def _called(action: argparse.Action) -> str:
    """Return what a user calls an option or an input."""
    return "/".join(action.option_strings) or str(action.metavar or action.dest)


def add_command(commands: Any, name: str, *, does: str, examples: str, **given: Any) -> Parser:
    """Add a command to the subparsers; `does` is its line in the list, `examples` end its help."""
    return commands.add_parser(
        name,
        help=does,
        description=given.pop("description", f"{does[0].upper()}{does[1:]}."),
        epilog=f"examples:\n{examples}",
        **given,
    )


def add_force(parser: argparse._ActionsContainer) -> None:
    """Add `--force`, which every command has that refuses to replace what is there."""
    parser.add_argument("--force", action="store_true", help="replace what is there")


def near(word: str, known: Iterable[str], *, say: str = "") -> str:
    """Return "did you mean …?" with the word of `known` that is nearest; `say` where none is near."""
    bare = {name.lstrip("-"): name for name in known}  # dashes would make all options alike
    found = difflib.get_close_matches(word.lstrip("-"), bare, n=1)
    return f"did you mean {bare[found[0]]}?" if found else say


def split_overrides(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the words without `--SECTION.KEY VALUE` and `--SECTION.KEY=VALUE`, and these."""
    rest, overrides, todo = [], [], list(words)
    while todo:
        word = todo.pop(0)
        name, equals, _ = word.partition("=")
        if not name.startswith("--") or "." not in name:
            rest.append(word)
            continue
        overrides.append(word)
        if not equals and todo and not todo[0].startswith("--"):
            overrides.append(todo.pop(0))
    return rest, overrides
