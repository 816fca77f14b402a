"""Work for the tests' farms: its functions are found by name in other processes."""

import os
import signal
import time
from pathlib import Path
from typing import Any

from garment_jax.farm.work import Work


def prepare() -> dict[str, int]:
    """What a worker keeps: its process, and how many jobs it has done."""
    return {"pid": os.getpid(), "done": 0}


def double(kept: dict[str, int], job: Any) -> tuple[int, int, int]:
    """Twice the job, this worker's process, and how many jobs it has done before."""
    if job == "refused":
        raise ValueError("seven is odd; give an even number.")
    if job == "fault":
        raise KeyError("legs")
    kept["done"] += 1
    return 2 * job, kept["pid"], kept["done"] - 1


def die(folder: Path, job: Any) -> int:
    """Kill this process at the first look at "dies once", and always at "dies"."""
    mark = folder / f"{job}-{os.getpid()}"
    if job == "dies" or (job == "dies once" and not list(folder.glob("dies once-*"))):
        mark.touch()
        time.sleep(0.7)  # a Dask nanny gives up a process that ends before it has heard of its start
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.05)
    return 1


def unable() -> None:
    raise ValueError("the model is not there; copy it.")


def folder_of(folder: Path) -> Path:
    return folder


DOUBLE = Work(prepare, double)
UNABLE = Work(unable, double)
