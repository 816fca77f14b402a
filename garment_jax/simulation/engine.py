"""Newton and warp, loaded quietly; imported only by modules that simulate.

Importing it raises `ValueError` where they are not installed.
"""

# pyright: reportMissingImports=false

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def _no_stderr() -> Iterator[None]:
    """Silence the file descriptor itself: warp's native part writes there that there is no GPU."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


try:
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING  # no greeting, no line for each kernel that is loaded
    wp.ScopedTimer.enabled = False  # the solver's own stopwatch
    with _no_stderr():
        wp.init()
    import newton
except ImportError as error:
    raise ValueError(
        "the simulation needs newton, which is missing: pip install 'garment-jax[sim]'."
    ) from error

__all__ = ["find_device", "newton", "wp"]


def find_device(name: str) -> Any:
    """Return warp's device called `name`; raises `ValueError` for one that is not there."""
    there = {device.alias: device for device in wp.get_devices()}  # get_device("cuda") complains on stderr
    found = there.get({"cuda": "cuda:0"}.get(name, name))
    if found is None:
        raise ValueError(f"the device {name} is not there; simulate here on {' or '.join(there)}.")
    return found
