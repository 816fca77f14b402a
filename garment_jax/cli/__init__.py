"""`garment-jax COMMAND`: one file a command, which adds its options and runs.

Commands import what they need when they run, so that `--help` is quick. What a user can do wrong ends
in one sentence and exit code 2.
"""

import argparse
import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import NoReturn

from garment_jax import __version__
from garment_jax.cli import (
    animate,
    benchmark,
    collide,
    evaluate,
    export,
    floor,
    import_,
    infer_command,
    info,
    learn,
    models,
    render,
    save,
    simulate,
    stability,
    train,
    validate,
    variants,
    view,
)
from garment_jax.cli.exit import INTERRUPTED, leave, listen, stopped
from garment_jax.cli.parser import Parser
from garment_jax.cli.printable import all_said, show_safely
from garment_jax.machine import absent_device

LONGEST_SENTENCE = 4000  # characters; a table of joints takes fewer
FAULT = 70  # of this package, as sysexits.h has it

GROUPS = {
    "use": (animate, view, export, render, info, models),
    "make": (learn, simulate, import_, validate, train, infer_command, evaluate, save, collide),
    "research": (floor, stability, benchmark, variants),
}
COMMANDS = tuple(command for commands in GROUPS.values() for command in commands)


def main(arguments: Sequence[str] | None = None) -> int:
    """Return a command's exit code: 0, 1 for faults found, 2 after a refusal, `FAULT` for ours.

    128 and the signal's number where one has ended it.
    """
    return carry_out(make_parser().parse_args(arguments))


def script(command: ModuleType) -> int:
    """Return the exit code of one command that is a program of its own: `train.py`, `infer.py`."""
    return carry_out(script_parser(command).parse_args())


def script_parser(command: ModuleType) -> Parser:
    """Return the parser of a command that is a program of its own."""
    parser = Parser(
        description=command.DESCRIPTION,
        epilog=f"examples:\n{command.EXAMPLES}",
    )
    command.add_arguments(parser)
    return parser


def carry_out(options: argparse.Namespace) -> int:
    """Run a parsed command; codes as of `main`."""
    try:
        check_paths(options)
        return options.run(options) or 0
    except KeyboardInterrupt:
        pass
    except Exception as error:
        if not stopped():  # what is interrupted may fail in other ways: a process that it waits for has ended
            return _failed(error)
    print(getattr(options, "stopped", "interrupted"), file=sys.stderr)
    return stopped() or INTERRUPTED


def _failed(error: Exception) -> int:
    """Say what is wrong and return the exit code."""
    sentence = str(error) if isinstance(error, ValueError | OSError) else absent_device()
    if sentence:
        print(f"error: {shortened(sentence)}", file=sys.stderr)
        return 2
    # ours, not the user's: never the code 1 of `validate`, which means faults found
    traceback.print_exception(error)
    print("error: this is a fault of garment-jax itself; please report the lines above.", file=sys.stderr)
    return FAULT


def shortened(sentence: str) -> str:
    """Return the sentence without the middle of what a damaged file put into it."""
    half = LONGEST_SENTENCE // 2
    return sentence if len(sentence) <= 2 * half else f"{sentence[:half]} ... {sentence[-half:]}"


def program(command: ModuleType | None = None) -> NoReturn:
    """Run the command line's command, or the one that is a program of its own, and end the process."""
    listen()
    show_safely()
    os.environ["MPLBACKEND"] = "Agg"  # pictures are files; a notebook's backend, inherited, may not be here
    try:
        options = (make_parser() if command is None else script_parser(command)).parse_args()
        if options.begins:
            print(options.begins, file=sys.stderr, flush=True)  # before a command imports what takes seconds
        code = carry_out(options)
    except SystemExit as stop:  # --help, a refusal of words; a training that has saved
        sys.exit(all_said(int(stop.code or 0)))
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        code = stopped() or INTERRUPTED
    leave(all_said(code))


def check_paths(options: argparse.Namespace) -> None:
    """Raise `OSError` for an option whose path runs in a circle of links."""
    for name, value in vars(options).items():
        for path in value if isinstance(value, list | tuple) else [value]:
            if isinstance(path, Path):
                _check_links(path, f"--{name.replace('_', '-')} " if name == "out" else "")


def _check_links(path: Path, option: str) -> None:
    try:
        path.resolve()
    except (RuntimeError, OSError) as error:  # Python 3.13 raises the second
        raise OSError(f"{option}{path} is a link that leads back to itself; name another place.") from error


def make_parser() -> Parser:
    """Return the parser of all commands."""
    parser = Parser(
        prog="garment-jax",
        usage="garment-jax COMMAND ...",
        epilog="begin with: garment-jax animate skirt",
    )
    parser.add_argument("--version", action="version", version=f"garment-jax {__version__}")
    commands = parser.add_subparsers(
        metavar="COMMAND", required=True, help=argparse.SUPPRESS, prog=parser.prog
    )
    lists = []
    for title, members in GROUPS.items():
        first = len(commands._choices_actions)
        for command in members:
            command.add(commands)
        lines = [f"  {one.dest:<10} {one.help}" for one in commands._choices_actions[first:]]
        lists.append("\n".join([title, *lines]))
    parser.description = "\n\n".join(
        [
            "Loose garments that move by themselves, learnt from simulation.",
            *lists,
            "garment-jax COMMAND --help shows a command's options and examples.",
        ]
    )
    return parser
