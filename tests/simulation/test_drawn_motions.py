"""Motions drawn from others: of many kinds, short enough, a function of seed and number alone."""

import numpy as np
import pytest

from garment_jax.body.vary import Variation
from garment_jax.config import SimulationConfig
from garment_jax.simulation.drawn_motions import Kind, drawn_motions, parse_kinds
from tests.reference.scene import make_motion, make_scene

SCENE = make_scene()
MOTIONS = [make_motion(SCENE, frames, seed) for seed, frames in enumerate((60, 45, 50, 70))]


def test_motions_are_short_enough_and_hang_on_seed_and_number_alone() -> None:
    whole = drawn_motions(MOTIONS, SCENE.body, 13, seed=5, longest=30)
    part = drawn_motions(MOTIONS, SCENE.body, 4, seed=5, longest=30)
    for a, b in zip(whole, part, strict=False):
        np.testing.assert_array_equal(a.rotations, b.rotations)
        np.testing.assert_array_equal(a.root, b.root)
    assert max(len(motion.root) for motion in whole) == 30
    assert all(np.isfinite(motion.rotations).all() for motion in whole)
    other = drawn_motions(MOTIONS, SCENE.body, 1, seed=6, longest=30)[0]
    assert not np.array_equal(other.root, whole[0].root)


def test_a_motion_that_is_varied_in_nothing_is_as_it_was_danced() -> None:
    kinds = parse_kinds(["varied tempo=1 legs=1 turn=0 begin=0"])
    danced = drawn_motions(MOTIONS, SCENE.body, 3, kinds=kinds, seed=0, longest=1000)
    for motion in danced:
        assert any(len(m.root) == len(motion.root) and np.allclose(m.root, motion.root) for m in MOTIONS)


def test_kinds_come_by_turns_and_those_of_the_configuration_are_the_default() -> None:
    by_default = drawn_motions(MOTIONS, SCENE.body, 2, seed=3, longest=30)
    named = drawn_motions(
        MOTIONS, SCENE.body, 2, kinds=parse_kinds(SimulationConfig().kinds), seed=3, longest=30
    )
    other = drawn_motions(
        MOTIONS, SCENE.body, 2, kinds=parse_kinds(["varied", "crossed"]), seed=3, longest=30
    )
    for a, b, c in zip(by_default, named, other, strict=True):
        np.testing.assert_array_equal(a.rotations, b.rotations)
        assert not np.array_equal(a.rotations, c.rotations)


def test_a_kind_is_read_from_its_words() -> None:
    varied, crossed = parse_kinds(["varied turn=40 kicks=2:6 begin=0.1", "crossed tempo=0.5:1.5 legs=1.1"])
    assert varied == Kind(1, Variation(turn=(-40, 40), kicks=(2, 6), begin=(0, 0.1)))
    assert crossed == Kind(3, Variation(tempo=(0.5, 1.5), legs=(1.1, 1.1), begin=(0, 0)))


@pytest.mark.parametrize(
    ("kinds", "sentence"),
    [
        ([], "kinds is empty"),
        ([""], "'' must begin with varied or crossed"),
        (["waltz turn=2"], "'waltz turn=2' must begin with varied or crossed"),
        (["varied speed=2"], "'speed' cannot be varied; choose of tempo, legs, turn"),
        (["varied turn"], "turn= is no number"),
        (["varied turn=nan"], "turn=nan is no number"),
        (["varied kicks=-1"], "kicks=-1 is no number"),
        (["varied kicks=6:2"], "kicks=6:2 is no number, nor two as LOW:HIGH"),
        (["varied tempo=0"], "tempo=0 is no number, nor two as LOW:HIGH of 0.1 or more"),
        (["crossed begin=0.1"], "a crossed motion has no begin"),
        (["varied begin=2"], "begin=2 is no number, nor two as LOW:HIGH from 0 to 1"),
        (["varied turn=1:2:3"], "turn=1:2:3 is no number"),
    ],
)
def test_other_words_are_refused(kinds: list[str], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        parse_kinds(kinds)


def test_two_motions_are_too_few_to_cross_and_vary_all_the_same() -> None:
    few = drawn_motions(MOTIONS[:2], SCENE.body, 8, seed=0, longest=20)
    assert len(few) == 8
