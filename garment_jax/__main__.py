"""`python -m garment_jax COMMAND`: the same as `garment-jax COMMAND`."""

import os
import signal
from importlib import import_module
from typing import NoReturn


def begin(command: str | None = None) -> NoReturn:
    """Run `garment-jax`, or the one `command` of a program of its own (`train.py`), and end the process.

    Ctrl-C ends it at once while its modules are imported: some crash where an import is broken off.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else it is ignored: `nohup`
        signal.signal(signal.SIGINT, _end)
    from garment_jax.cli import program

    program(None if command is None else import_module(f"garment_jax.cli.{command}"))


def _end(number: int, frame: object) -> NoReturn:
    os.write(2, b"interrupted\n")
    os._exit(128 + number)


if __name__ == "__main__":
    begin()
