"""What is asked for, decided, and done, in `plan.json` of the work folder: a call that goes on reads it."""

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from garment_jax.storage.whole import write_text

PLAN = "plan.json"


class Plan(NamedTuple):
    """Decisions, None until they are made; JSON values."""

    asked: Mapping[str, Any]  # what the same command gives again
    seconds_per_frame: float | None = None  # of one simulating process
    kept_back: int | None = None  # frames
    frames: int | None = None  # to learn from
    left_out: Sequence[str] = ()  # clips that failed the screening, so that none is simulated again
    seconds_per_step: Mapping[str, float] | None = None
    overhead_seconds: float | None = None  # of training, beside its steps
    steps: Mapping[str, int] | None = None
    seconds: Mapping[str, float] = {}  # that each part has taken, over all calls
    trained: bool = False  # what is in --out from now on is ours
    done: bool = False


class PlanFile:
    """The plan of a work folder; every change is written at once."""

    def __init__(self, folder: Path, asked: Mapping[str, Any]) -> None:
        """Open the plan of `folder`, or begin one.

        Raises `ValueError` for a folder of something else, a damaged plan, and one of another command.
        """
        self._path = folder / PLAN
        self.plan = Plan(dict(asked))
        if self._path.is_file():
            self.plan = _read(self._path)
            _check_same(self.plan.asked, asked, folder)
            return
        others = [path.name for path in folder.iterdir() if not path.name.startswith(".")]
        if others:
            raise ValueError(f"{folder} holds {sorted(others)[0]!r} but no {PLAN}; name another --work.")

    def decide(self, **changes: Any) -> Plan:
        """Change the plan, write it, and return it."""
        self.plan = self.plan._replace(**changes)
        write_text(self._path, json.dumps(self.plan._asdict(), indent=1) + "\n")
        return self.plan

    @contextmanager
    def timed(self, part: str) -> Iterator[None]:
        """Add the seconds of what follows to those of `part`, however it ends."""
        began = time.monotonic()
        try:
            yield
        finally:
            before = self.plan.seconds
            seconds = round(before.get(part, 0.0) + time.monotonic() - began, 1)
            self.decide(seconds={**before, part: seconds})


def _read(path: Path) -> Plan:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return Plan(**found)
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"{path} is damaged ({error}); name another --work, or remove the folder."
        ) from error


def _check_same(known: Mapping[str, Any], asked: Mapping[str, Any], folder: Path) -> None:
    for name, value in asked.items():
        if known.get(name) != value:
            raise ValueError(
                f"{folder} was begun with {name} {known.get(name)}, not {value}; give the same again, or "
                "name another --work."
            )
