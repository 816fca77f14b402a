"""The progress line: overwritten on a terminal, rare elsewhere."""

import io
from typing import Any

import pytest

from garment_jax.training import progress
from garment_jax.training.progress import Progress, duration


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch: Any) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_a_terminal_line_is_overwritten_and_ended_once(clock: list[float]) -> None:
    stream = Terminal()
    line = Progress("motion", start=100, steps=200, frames_per_step=50, stream=stream)
    clock[0] += 5
    line.show(110, 0.5)
    line.show(111, 0.4)
    line.close()
    line.close()
    first, second = stream.getvalue().split("\r")[1:]
    # 10 steps of 50 frames in 5 s: 100 frames/s, and 90 steps at 2 a second are left.
    assert first.rstrip() == "motion  110/200  100 frames/s  0:45 left  loss 0.5"
    assert second.startswith("motion  111/200")
    assert stream.getvalue().count("\n") == 1


def test_elsewhere_a_line_comes_every_ten_seconds_and_at_the_end(clock: list[float]) -> None:
    stream = io.StringIO()
    line = Progress("motion", start=0, steps=30, stream=stream)
    for step in range(1, 30):
        clock[0] += 1
        line.show(step, 1.0)
    line.show(30, 1.0, last=True)
    shown = [text.split()[1] for text in stream.getvalue().splitlines()]
    assert shown == ["1/30", "11/30", "21/30", "30/30"]


def test_durations() -> None:
    assert [duration(s) for s in (0, 61.4, 3_661)] == ["0:00", "1:01", "1:01:01"]
