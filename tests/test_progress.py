"""The frames' progress: one line that is rewritten on a terminal, a line now and then elsewhere."""

import io
from contextlib import suppress
from typing import Any

import pytest

from garment_jax import progress
from garment_jax.progress import FrameProgress, duration


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch: Any) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_a_terminal_shows_frames_speed_and_time_left_and_is_left_clean(clock: list[float]) -> None:
    stream = Terminal()
    with FrameProgress("walk_01", stream=stream) as show:
        clock[0] += 20
        show(10, 40)
        clock[0] += 20
        show(40, 40)
    first, last, blank, rest = stream.getvalue().split("\r")[1:]
    assert first.rstrip() == "walk_01: 10/40 frames, 0.5 frames/s, 1:00 left"
    assert last.rstrip() == "walk_01: 40/40 frames, 1.0 frames/s, 0:00 left"
    assert (blank.strip(), rest) == ("", "")
    assert len(blank) >= len(first)
    assert "\n" not in stream.getvalue()


def test_the_time_of_compiling_is_no_speed_of_frames(clock: list[float]) -> None:
    stream = Terminal()
    with FrameProgress("walk_01", stream=stream) as show:
        clock[0] += 600
        show.begin(10)
        clock[0] += 5
        show(20, 40)
    assert stream.getvalue().split("\r")[1].rstrip() == "walk_01: 20/40 frames, 2.0 frames/s, 0:10 left"


def test_many_fast_frames_are_a_few_prints_a_second(clock: list[float]) -> None:
    stream = Terminal()
    with FrameProgress("walk_01", stream=stream) as show:
        for done in range(1, 1_001):
            clock[0] += 0.01
            show(done, 1_000)
    assert 20 <= stream.getvalue().count("walk_01") <= 40  # in 10 seconds


def test_elsewhere_a_line_comes_every_half_minute(clock: list[float]) -> None:
    stream = io.StringIO()
    with FrameProgress("drape", stream=stream) as show:
        for done in range(1, 101):
            clock[0] += 1
            show(done, 100)
    assert stream.getvalue().splitlines() == [
        "drape: 30/100 frames, 1.0 frames/s, 1:10 left",
        "drape: 60/100 frames, 1.0 frames/s, 0:40 left",
        "drape: 90/100 frames, 1.0 frames/s, 0:10 left",
    ]


def test_what_comes_before_the_first_frame_is_said_on_a_terminal_alone() -> None:
    for stream, said in ((Terminal(), "\rwaltz: compiling"), (io.StringIO(), "")):
        show = FrameProgress("waltz", stream=stream)
        show.say("compiling")
        assert stream.getvalue() == said
        show.__exit__(None, None, None)
        assert stream.getvalue().endswith("\r" if said else "")


def test_an_interrupted_line_is_ended_and_nothing_shown_is_nothing_written(clock: list[float]) -> None:
    stream = Terminal()
    with suppress(KeyboardInterrupt), FrameProgress("drape", stream=stream) as show:
        clock[0] += 1
        show(1, 45)
        raise KeyboardInterrupt
    assert stream.getvalue().endswith("\r")
    quiet = Terminal()
    with FrameProgress("drape", stream=quiet) as show:
        show(1, 45)
    assert quiet.getvalue() == ""


def test_training_counts_its_own_steps_in_frames_and_shows_the_last(clock: list[float]) -> None:
    stream = io.StringIO()
    with FrameProgress("motion", unit="steps", start=100, frames_per_step=50, stream=stream) as show:
        clock[0] += 5
        show(110, 200, note="loss 0.5")  # too early for a log file
        show(110, 200, note="loss 0.5", last=True)
    # 10 steps of 50 frames in 5 s: 100 frames/s, and 90 steps at 2 a second are left
    assert stream.getvalue() == "motion: 110/200 steps, 100 frames/s, 0:45 left, loss 0.5\n"


def test_durations() -> None:
    assert [duration(s) for s in (0, 61.4, 3_661)] == ["0:00", "1:01", "1:01:01"]
