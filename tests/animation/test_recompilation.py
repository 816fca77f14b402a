"""A new clip length or number of motions compiles nothing: counted by JAX's own events."""

from collections.abc import Iterator

import jax
import numpy as np
import pytest

from garment_jax.animation.animate import make_animator
from garment_jax.animation.clips import rollout_many
from garment_jax.model.scan import make_rollout
from tests.animation.tiny_model import CONFIG, SCENE, alone, first_state, inputs_of, template, tiny_model
from tests.reference.scene import make_motion

EVENT = "/jax/core/compile/backend_compile_duration"
_compiled: list[str] = []


@pytest.fixture(scope="module", autouse=True)
def listener() -> Iterator[None]:
    """Note every program that XLA is asked for, from its cache on disk too."""

    def note(event: str, duration: float, **_) -> None:
        if event == EVENT:
            _compiled.append(event)

    jax.monitoring.register_event_duration_secs_listener(note)
    yield
    jax._src.monitoring.unregister_event_duration_listener(note)  # type: ignore[attr-defined]


def compiled() -> int:
    """Return how many programs were compiled since the last call."""
    count = len(_compiled)
    _compiled.clear()
    return count


def test_the_counter_counts():
    compiled()
    jax.jit(lambda x: x * 3.25)(np.ones(7, np.float32)).block_until_ready()
    assert compiled() > 0


@pytest.mark.parametrize("collision", [False, True])
def test_a_new_clip_length_compiles_nothing(collision: bool):
    run = make_animator(tiny_model(), SCENE, collision=collision)

    def frames(count: int, seed: int) -> int:
        return sum(len(chunk.V) for chunk in run(make_motion(SCENE, count, seed=seed)))

    compiled()
    assert frames(18, 0) == 18
    assert compiled() > 0
    assert [frames(count, 1) for count in (1, 5, 16, 37)] == [1, 5, 16, 37]
    assert compiled() == 0


def test_a_new_number_of_motions_compiles_nothing_and_each_is_rolled_out_as_alone():
    motions = [inputs_of(make_motion(SCENE, t, seed=s)) for s, t in enumerate((7, 20, 9, 33, 5))]
    params, run = tiny_model().params, make_rollout(template(), CONFIG)

    def many(count: int) -> dict[int, np.ndarray]:
        chosen = motions[:count]
        x = [m.x for m in chosen]
        return dict(rollout_many(run, params, first_state(*chosen), x, chunk=CONFIG.rollout.chunk, lanes=2))

    everything = many(5)
    assert sorted(everything) == [0, 1, 2, 3, 4]
    for i, motion in enumerate(motions):
        expected = run(params, alone(first_state(motion)), motion.x)[1]
        np.testing.assert_allclose(everything[i], expected, atol=2e-5, rtol=0)
    state = first_state(*motions[:3])
    compiled()
    made = rollout_many(run, params, state, [m.x for m in motions[:3]], chunk=CONFIG.rollout.chunk, lanes=2)
    assert sorted(i for i, _ in made) == [0, 1, 2]
    assert compiled() == 0
