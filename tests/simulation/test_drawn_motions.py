"""Motions drawn from others: of many kinds, short enough, a function of seed and number alone."""

import numpy as np

from garment_jax.simulation.drawn_motions import KINDS, drawn_motions
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


def test_one_kind_is_a_recorded_motion_as_it_was_danced() -> None:
    k = next(k for k, (_, variation) in enumerate(KINDS) if variation.tempo == (1, 1))
    danced = drawn_motions(MOTIONS, SCENE.body, k + 1, seed=0, longest=1000)[k]
    assert any(len(m.root) == len(danced.root) and np.allclose(m.root, danced.root) for m in MOTIONS)


def test_two_motions_are_too_few_to_cross_and_vary_all_the_same() -> None:
    few = drawn_motions(MOTIONS[:2], SCENE.body, 8, seed=0, longest=20)
    assert len(few) == 8
