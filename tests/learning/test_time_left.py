"""The time left of the whole, from planned parts and the present one's own."""

import io

from garment_jax.learning.time_left import TimeLeft
from garment_jax.progress import FrameProgress, part_of_whole


def test_a_part_counts_with_its_own_time_and_the_later_ones_as_planned() -> None:
    now = [0.0]
    left = TimeLeft({"simulate": 100.0, "train": 200.0, "measure": 50.0}, clock=lambda: now[0])
    assert left() == "all: 5:50 left"
    now[0] = 40.0
    assert left("walk", 10.0) == "all: 5:10 left"  # a piece of the part: 60 of it are planned
    assert left("walk", 90.0) == "all: 5:40 left"
    left.plan(train=0.0, generative=30.0, column_rnn=120.0)
    assert left("generative", 25.0) == "all: 3:15 left"
    assert left("column_rnn", 10.0) == "all: 1:00 left"
    left.begin("measure")
    now[0] = 60.0
    assert left() == "all: 0:30 left"
    now[0] = 500.0
    assert left() == "all: 0:00 left"


def test_lines_of_progress_inside_end_with_it() -> None:
    stream = io.StringIO()
    with part_of_whole(lambda name, left: f"{name} and all"), FrameProgress("motion", stream=stream) as show:
        show(1, 2, note="loss 1", last=True)
    show(2, 2, last=True)
    inside, outside = stream.getvalue().splitlines()
    assert inside.endswith("left, loss 1, motion and all")
    assert outside.endswith(" left")
