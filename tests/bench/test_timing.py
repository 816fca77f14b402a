"""What a measurement of run time counts, on a runner that only counts; no clock is looked at."""

from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from garment_jax.animation.animate import Chunk
from garment_jax.baselines import Runner, Stream
from garment_jax.bench.timing import WARM_UP, first_frames, time_batch, time_chunks, time_steps
from garment_jax.structs import Motion, Scene
from tests.reference.scene import make_motion, make_scene

SCENE = make_scene(4, 16)
MOTION = make_motion(SCENE, 10)


class Counter:
    """A method that notes what it is asked for."""

    def __init__(self) -> None:
        self.steps: list[int] = []
        self.batches: list[tuple[int, int]] = []

    def animate(self, scene: Scene, motion: Motion, name: str) -> Iterator[Chunk]:
        for k in (4, 4, 2):
            yield Chunk(np.zeros((k, 2, 3), np.float32), np.zeros(k, np.float32))

    def stream(self, scene: Scene, motion: Motion, name: str) -> Stream:
        def step(state: int, x: int) -> tuple[int, np.ndarray]:
            self.steps.append(int(x))
            return state + 1, np.zeros((2, 3), np.float32)

        return Stream(np.arange(10), 0, step, step, motion.root, np.zeros(10))  # type: ignore[arg-type]

    def rollout_batch(self, scene: Scene, motions: Sequence[Motion], name: str) -> list[np.ndarray]:
        self.batches.append((len(motions), len(motions[0].root)))
        return []

    def runner(self) -> Runner:
        return Runner({}, 0, self.animate, self.rollout_batch, self.stream)


def test_chunks_of_the_usual_length_after_the_first_count() -> None:
    found = time_chunks(Counter().runner(), SCENE, MOTION, "x")
    assert (found["chunk"], found["chunks"]) == (4, 1)
    assert found["ms_per_frame"] == found["ms_per_frame_p95"]  # of one chunk
    assert found["compile_s"] >= 0


def test_steps_go_through_the_motion_after_a_warm_up() -> None:
    counter = Counter()
    found = time_steps(counter.runner(), SCENE, MOTION, "x", steps=7)
    assert counter.steps == [t % 10 for t in range(7 + WARM_UP)]
    assert found["step_ms"] <= found["step_ms_p95"]
    assert time_steps(Runner({}, 0), SCENE, MOTION, "x", steps=7) == {"step_ms": None, "step_ms_p95": None}


def test_a_batch_is_a_long_and_a_short_one_twice() -> None:
    counter = Counter()
    time_batch(counter.runner(), SCENE, MOTION, "x", batch=3)
    assert counter.batches == [(3, 2), (3, 10), (3, 2), (3, 10)]
    nothing = {"batch": None, "batch_frames_per_s": None}
    assert time_batch(Runner({}, 0), SCENE, MOTION, "x", batch=3) == nothing


@pytest.mark.parametrize(("asked", "given"), [(4, 4), (99, 10)])
def test_first_frames(asked: int, given: int) -> None:
    short = first_frames(MOTION, asked)
    assert len(short.root) == len(short.rotations) == given
    assert short.fps == MOTION.fps
