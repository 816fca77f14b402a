"""The log holds one JSON object a line, whatever happens to the process that writes it."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from garment_jax.training.log import RunLog, read_log


def test_lines_are_strict_json_and_on_disk_at_once(tmp_path: Path) -> None:
    with RunLog(tmp_path) as log:
        log.write("motion", 20, {"loss": 1.5, "condition": float("inf")}, seconds=3.0)
        text = (tmp_path / "log.jsonl").read_text()
    assert json.loads(text) == {
        "stage": "motion", "step": 20, "kind": "train", "seconds": 3.0, "loss": 1.5, "condition": None
    }  # fmt: skip


def test_truncating_drops_later_steps_of_that_stage_and_a_torn_line(tmp_path: Path) -> None:
    with RunLog(tmp_path) as log:
        log.write("generative", 500, {"loss": 1.0})
        for step in (10, 20, 30):
            log.write("motion", step, {"loss": 1.0})
    with open(tmp_path / "log.jsonl", "a") as file:
        file.write('{"stage": "mot')
    assert [e["step"] for e in read_log(tmp_path, stage="motion")] == [10, 20, 30]
    with RunLog(tmp_path) as log:
        log.truncate("motion", 20)
        log.write("motion", 25, {"loss": 2.0})
    assert [(e["stage"], e["step"]) for e in read_log(tmp_path)] == [
        ("generative", 500), ("motion", 10), ("motion", 20), ("motion", 25)
    ]  # fmt: skip


def test_tensorboard_gets_the_same_values_when_asked(tmp_path: Path) -> None:
    pytest.importorskip("tensorboardX")
    with RunLog(tmp_path, tensorboard=True) as log:
        log.write("motion", 10, {"loss": 1.0})
    assert list((tmp_path / "tensorboard" / "motion").glob("events*"))


def test_tensorboard_without_its_package_is_refused(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setitem(sys.modules, "tensorboardX", None)
    with pytest.raises(ValueError, match=r"pip install 'garment-jax\[tensorboard\]'"):
        RunLog(tmp_path, tensorboard=True)
