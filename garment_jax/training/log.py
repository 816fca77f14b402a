"""The run's log: one JSON object a line, and TensorBoard when it is asked for.

A line holds `stage`, `step`, `kind` ("train" or "validation"), `seconds` and the values.
One process writes; a resumed run first cuts what the lost steps had written.
"""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from garment_jax.storage.whole import write_text

FILE_NAME = "log.jsonl"


class RunLog:
    """Appends to `run_dir/log.jsonl`; each line is on disk's side of the process when `write` returns.

    `tensorboard=True` writes the same values to run_dir/tensorboard/STAGE as well and needs the
    package tensorboardX (extra `tensorboard`); ValueError if it is missing. `silent` writes nothing.
    """

    def __init__(self, run_dir: str | Path, *, tensorboard: bool = False, silent: bool = False) -> None:
        self.path, self._silent = Path(run_dir) / FILE_NAME, silent
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._writers: dict[str, Any] = {}
        self._writer_class = _tensorboard_writer() if tensorboard and not silent else None
        self._file = open(os.devnull if silent else self.path, "a", encoding="utf-8")  # noqa: SIM115 (closed by close)

    def write(
        self, stage: str, step: int, values: Mapping[str, float], *, kind: str = "train", seconds: float = 0.0
    ) -> None:
        """Append one line; `seconds` is the stage's time so far. A value that is not finite becomes null."""
        entry = {"stage": stage, "step": step, "kind": kind, "seconds": round(seconds, 3)}
        entry |= {name: float(value) if math.isfinite(value) else None for name, value in values.items()}
        self._file.write(json.dumps(entry) + "\n")
        self._file.flush()
        if self._writer_class is not None:
            for name, value in values.items():
                self._writer(stage, step).add_scalar(f"{kind}/{name}", float(value), step)

    def truncate(self, stage: str, step: int) -> None:
        """Drop the stage's lines after `step`, and a last line that a kill left torn."""
        if self._silent:
            return
        self._file.close()
        kept = [line for line, entry in _lines(self.path) if entry["stage"] != stage or entry["step"] <= step]
        write_text(self.path, "".join(kept))
        self._file = open(self.path, "a", encoding="utf-8")  # noqa: SIM115

    def close(self) -> None:
        """Close the files; the log can be read at any time, closed or not."""
        self._file.close()
        for writer in self._writers.values():
            writer.close()

    def __enter__(self) -> "RunLog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _writer(self, stage: str, step: int) -> Any:
        if stage not in self._writers and self._writer_class is not None:
            # purge_step hides the points that an interrupted run had written from here on.
            folder = str(self.path.parent / "tensorboard" / stage)
            self._writers[stage] = self._writer_class(folder, purge_step=step)
        return self._writers[stage]


def read_log(run_dir: str | Path, *, stage: str = "", kind: str = "") -> list[dict[str, Any]]:
    """The log's entries in order, of one stage and kind if named; a torn last line is left out."""
    entries = [entry for _, entry in _lines(Path(run_dir) / FILE_NAME)]
    return [e for e in entries if stage in ("", e["stage"]) and kind in ("", e["kind"])]


def _lines(path: Path) -> list[tuple[str, dict[str, Any]]]:
    if not path.exists():
        return []
    pairs = []
    for line in path.read_text(encoding="utf-8").splitlines(keepends=True):
        try:
            pairs.append((line, json.loads(line)))
        except json.JSONDecodeError:
            break  # the process was killed while it wrote this line, so it is the last one
    return pairs


def _tensorboard_writer() -> Any:
    try:
        from tensorboardX import SummaryWriter  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ValueError(
            "TensorBoard was asked for but tensorboardX is missing; pip install 'garment-jax[tensorboard]'."
        ) from error
    return SummaryWriter
