"""`garment-jax COMMAND`: one file a command, which adds its options and runs.

Commands import what they need when they run, so that `--help` is quick. What a user can do wrong ends
in one sentence and exit code 2.
"""

import argparse
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
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
    info,
    models,
    render,
    save,
    simulate,
    stability,
    validate,
    variants,
    view,
)
from garment_jax.cli.exit import INTERRUPTED, leave
from garment_jax.cli.printable import show_safely

LONGEST_SENTENCE = 4000  # characters; a table of joints takes fewer
FAULT = 70  # of this package, as sysexits.h has it

COMMANDS = (
    animate,
    simulate,
    floor,
    import_,
    info,
    validate,
    collide,
    evaluate,
    render,
    stability,
    benchmark,
    save,
    models,
    variants,
    export,
    view,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Return a command's exit code: 0, 1 for faults found, 2 after a refusal, `FAULT` for ours."""
    options = make_parser().parse_args(arguments)
    try:
        check_paths(options)
        return options.run(options) or 0
    except BrokenPipeError:
        sys.stderr.close()  # the reader (head, less) has had enough; nothing is wrong
        return 0
    except (ValueError, OSError) as error:
        print(f"error: {shortened(str(error))}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except Exception:  # ours, not the user's: never the code 1 of `validate`, which means faults found
        traceback.print_exc()
        print("error: this is a fault of garment-jax itself; please report the lines above.", file=sys.stderr)
        return FAULT


def shortened(sentence: str) -> str:
    """Return the sentence without the middle of what a damaged file put into it."""
    half = LONGEST_SENTENCE // 2
    return sentence if len(sentence) <= 2 * half else f"{sentence[:half]} ... {sentence[-half:]}"


def program() -> NoReturn:
    """Run the command line's command and end the process."""
    show_safely()
    leave(main())


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


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = argparse.ArgumentParser(
        prog="garment-jax", description="Dynamic garments learnt from simulation."
    )
    parser.add_argument("--version", action="version", version=f"garment-jax {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in COMMANDS:
        command.add(commands)
    return parser
