"""`garment-jax COMMAND`: one file a command, which adds its options and runs.

Commands import what they need when they run, so that `--help` is quick. What a user can do wrong ends
in one sentence and exit code 2.
"""

import argparse
import sys
from collections.abc import Sequence
from typing import NoReturn

from garment_jax import __version__
from garment_jax.cli import (
    benchmark,
    collide,
    evaluate,
    export,
    floor,
    import_,
    info,
    render,
    save,
    simulate,
    stability,
    validate,
    view,
)
from garment_jax.cli.leaving import INTERRUPTED, leave

COMMANDS = (
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
    export,
    view,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return the exit code (0, 1 for a red stability report, 2 after a refusal)."""
    options = make_parser().parse_args(arguments)
    try:
        return options.run(options) or 0
    except BrokenPipeError:
        sys.stderr.close()  # the reader (head, less) has had enough; nothing is wrong
        return 0
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


def program() -> NoReturn:
    """Run the command line's command and end the process."""
    leave(main())


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
