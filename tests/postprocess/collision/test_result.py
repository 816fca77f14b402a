"""Two solves of a frame told as one."""

import jax.numpy as jnp
import pytest

from garment_jax.postprocess.collision.result import (
    MESSAGES,
    CollisionResult,
    Outcome,
    Planes,
    joined,
)


def result(*, before: int, after: int, steps: int, outcome: Outcome) -> CollisionResult:
    planes = Planes(jnp.zeros((3, 2)), jnp.zeros(2))
    depth = jnp.float32(0.001)
    counts = (jnp.int32(before), jnp.int32(after), jnp.int32(steps))
    told = (jnp.float32(0), jnp.array(True), jnp.int32(outcome))
    return CollisionResult(jnp.zeros((2, 3)), before * depth, after * depth, *counts, *told, planes)


def test_what_was_before_is_the_first_ones_and_steps_are_both_ones():
    one = result(before=5, after=1, steps=7, outcome=Outcome.STEPS_SPENT)
    both = joined(one, result(before=2, after=0, steps=4, outcome=Outcome.CONVERGED), first=False)
    assert (int(both.penetrating_before), int(both.penetrating_after), int(both.steps)) == (5, 0, 11)
    assert float(both.deepest_before) == pytest.approx(0.005)
    assert int(both.outcome) == Outcome.CONVERGED


@pytest.mark.parametrize("first", [Outcome.NOTHING_TO_DO, Outcome.CONVERGED])
def test_nothing_more_to_do_is_not_nothing_done(first: Outcome):
    one = result(before=0, after=0, steps=0, outcome=first)
    both = joined(one, result(before=0, after=0, steps=0, outcome=Outcome.NOTHING_TO_DO), first=False)
    assert int(both.outcome) == first


def test_the_first_is_as_it_is():
    none = result(before=0, after=0, steps=0, outcome=Outcome.CONVERGED)
    both = joined(
        none, result(before=3, after=0, steps=2, outcome=Outcome.NOTHING_TO_DO), first=jnp.array(True)
    )
    assert (int(both.penetrating_before), int(both.steps)) == (3, 2)
    assert int(both.outcome) == Outcome.NOTHING_TO_DO


def test_remedies_are_options_of_collide_and_keys_of_a_configuration():
    """Of Python's parameters a user of the command knows nothing."""
    assert not any("`" in sentence for sentence in MESSAGES.values())
    for outcome, name in ((Outcome.STEPS_SPENT, "iterations"), (Outcome.MARGIN_MISSED, "eps")):
        assert f"(--{name}, collision.{name} in a configuration)" in MESSAGES[outcome]
