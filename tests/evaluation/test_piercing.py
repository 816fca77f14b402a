"""Bones through cloth, against a linear system for every bone and triangle."""

import numpy as np
import pytest

from garment_jax.evaluation.piercing import pierced_bones
from tests.postprocess.collision.cloth import sheet

V, FACES = sheet(0.0)


def test_a_bone_through_the_sheet_counts_and_one_beside_or_above_does_not():
    through = np.array([[0.013, -0.2, 0.017], [0.02, 0.3, 0.02]])
    above = through + [0, 0.25, 0]
    beside = through + [0.8, 0, 0]
    bones = np.stack([through, above, beside])
    np.testing.assert_array_equal(pierced_bones(V[None], bones[None], FACES), [1])
    np.testing.assert_array_equal(pierced_bones(V[None], bones[None, 1:], FACES), [0])


def test_a_bone_that_ends_on_the_sheet_does_not_count():
    bone = np.array([[[[0.013, 0.0, 0.017], [0.013, 0.4, 0.017]]]])
    np.testing.assert_array_equal(pierced_bones(V[None], bone, FACES), [0])


@pytest.mark.parametrize("seed", range(3))
def test_random_bones_against_a_linear_system_each(seed: int):
    rng = np.random.default_rng(seed)
    wavy = V + np.stack([0 * V[:, 0], 0.1 * np.sin(9 * V[:, 0]), 0 * V[:, 0]], -1).astype(np.float32)
    bones = rng.uniform(-0.6, 0.6, (60, 2, 3))
    a, b, c = (wavy[FACES[:, k]].astype(float) for k in range(3))
    hit = []
    for i, (p, q) in enumerate(bones):  # p + s (q - p) = a + u (b - a) + v (c - a)
        system = np.stack([np.broadcast_to(p - q, a.shape), b - a, c - a], axis=-1)
        s, u, v = np.linalg.solve(system, (p - a)[..., None])[..., 0].T
        if ((s > 0) & (s < 1) & (u > 0) & (v > 0) & (u + v < 1)).any():
            hit.append(i)
    frames = np.repeat(wavy[None], 60, axis=0)
    found = np.flatnonzero(pierced_bones(frames, bones[:, None], FACES))
    np.testing.assert_array_equal(found, hit)
    assert 5 < len(hit) < 55
