"""The frames' progress: one line that is rewritten on a terminal, a line now and then elsewhere."""

import io
import threading
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
    begun, shown = stream.getvalue().split("\r")[1:3]
    assert begun == "walk_01: 10 frames"
    assert shown.rstrip() == "walk_01: 20/40 frames, 2.0 frames/s, 0:10 left"


def test_the_first_frames_after_what_was_said_are_no_speed(clock: list[float]) -> None:
    stream = io.StringIO()
    with FrameProgress("walk_01", stream=stream) as show:
        show.say("compiling")
        clock[0] += 600
        show(10, 40)
        clock[0] += 5
        show(20, 40)
    assert stream.getvalue() == "walk_01: 20/40 frames, 2.0 frames/s, 0:10 left\n"


def test_many_fast_frames_are_a_few_prints_a_second(clock: list[float]) -> None:
    stream = Terminal()
    with FrameProgress("walk_01", stream=stream) as show:
        for done in range(1, 1_001):
            clock[0] += 0.01
            show(done, 1_000)
    assert 20 <= stream.getvalue().count("walk_01") <= 40  # in 10 seconds


def test_elsewhere_a_line_comes_soon_and_then_every_half_minute(clock: list[float]) -> None:
    stream = io.StringIO()
    with FrameProgress("drape", stream=stream) as show:
        for done in range(1, 101):
            clock[0] += 1
            show(done, 100)
    assert stream.getvalue().splitlines() == [
        "drape: 2/100 frames, 1.0 frames/s, 1:38 left",
        "drape: 32/100 frames, 1.0 frames/s, 1:08 left",
        "drape: 62/100 frames, 1.0 frames/s, 0:38 left",
        "drape: 92/100 frames, 1.0 frames/s, 0:08 left",
    ]


def wait_for(stream: io.StringIO, text: str) -> None:
    for _ in range(2_000):
        if text in stream.getvalue():
            return
        threading.Event().wait(0.01)
    raise AssertionError(f"{text!r} is not in {stream.getvalue()!r}")


def test_what_comes_before_the_first_frame_is_said_with_a_clock_on_a_terminal_and_once_elsewhere(
    clock: list[float], monkeypatch: Any
) -> None:
    monkeypatch.setattr(progress, "_SAID_SECONDS", 0.01)
    terminal, log = Terminal(), io.StringIO()
    with FrameProgress("waltz", stream=terminal) as shown, FrameProgress("waltz", stream=log) as logged:
        shown.say("compiling")
        assert terminal.getvalue() == "\rwaltz: compiling"
        logged.say("compiling")
        wait_for(log, "waltz: compiling\n")
        clock[0] += 61
        wait_for(terminal, "\rwaltz: compiling, 1:01")
        shown.begin(4)
        ended = len(terminal.getvalue())
        threading.Event().wait(0.05)
        assert len(terminal.getvalue()) == ended
    assert log.getvalue() == "waltz: compiling\n"
    assert terminal.getvalue().endswith("\r")


def test_what_is_over_at_once_is_not_said_elsewhere() -> None:
    log = io.StringIO()
    with FrameProgress("waltz", stream=log) as show:
        show.say("compiling")
        show.begin(4)
    threading.Event().wait(0.01)
    assert log.getvalue() == ""


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
        clock[0] += 1
        show(110, 200, note="loss 0.5")  # too early for a log file
        clock[0] += 4
        show(110, 200, note="loss 0.5", last=True)
    # 10 steps of 50 frames in 5 s: 100 frames/s, and 90 steps at 2 a second are left
    assert stream.getvalue() == "motion: 110/200 steps, 100 frames/s, 0:45 left, loss 0.5\n"


def test_durations() -> None:
    assert [duration(s) for s in (0, 61.4, 3_661)] == ["0:00", "1:01", "1:01:01"]
