"""Sparse weights against a search over a fine grid of the simplex, and error sums against loops."""

from itertools import product

import numpy as np

from garment_jax.geometry.bone_errors import bone_moments, pair_errors, single_errors
from garment_jax.geometry.sparse_weights import fit_weights

RNG = np.random.default_rng(0)
REST = RNG.normal(size=(7, 3))
R, T = np.linalg.qr(RNG.normal(size=(9, 4, 3, 3)))[0], RNG.normal(size=(9, 4, 3))
FRAMES = RNG.normal(size=(9, 7, 3))
MOMENTS = bone_moments(REST, FRAMES, R, T, window=4)


def error(i: int, w: np.ndarray) -> float:
    """The squared error of vertex i over all frames, by a loop."""
    total = 0.0
    for t in range(9):
        total += np.square(sum(w[j] * (R[t, j] @ REST[i] + T[t, j]) for j in range(4)) - FRAMES[t, i]).sum()
    return total


def test_error_sums_are_those_of_loops():
    G = pair_errors(MOMENTS, slice(None))
    for i in range(7):
        w = RNG.dirichlet(np.ones(4))
        np.testing.assert_allclose(w @ G[i] @ w, error(i, w), rtol=1e-9)
    singles = [[error(i, np.eye(4)[j]) for j in range(4)] for i in range(7)]
    np.testing.assert_allclose(single_errors(MOMENTS), singles, rtol=1e-9)


def test_no_weights_of_a_fine_grid_are_better():
    found = fit_weights(MOMENTS, influences=4)
    grid = [np.array(w) / 20 for w in product(range(21), repeat=4) if sum(w) == 20]
    G = pair_errors(MOMENTS, slice(None))  # checked by loops above
    for i in range(7):
        assert found[i] @ G[i] @ found[i] <= min(w @ G[i] @ w for w in grid) * (1 + 1e-9)


def test_few_influences_and_allowed_bones_are_kept_and_a_start_is_never_made_worse():
    allowed = np.ones((7, 4), bool)
    allowed[:, 2] = False
    start = np.tile([0.5, 0.5, 0.0, 0.0], (7, 1))
    for found in (
        fit_weights(MOMENTS, start, influences=2, allowed=allowed),
        fit_weights(MOMENTS, influences=2),
    ):
        assert (np.count_nonzero(found, axis=1) <= 2).all()
        np.testing.assert_allclose(found.sum(axis=1), 1)
        assert (found >= 0).all()
        assert all(error(i, found[i]) <= error(i, start[i]) * (1 + 1e-9) for i in range(7))
    assert (fit_weights(MOMENTS, start, influences=2, allowed=allowed)[:, 2] == 0).all()


def test_a_bone_that_is_not_allowed_never_enters():
    """Also where every allowed bone is in use already: then there is none to enter."""
    allowed = np.ones((7, 4), bool)
    allowed[:, 0] = False
    start = np.tile([0.0, 1 / 3, 1 / 3, 1 / 3], (7, 1))
    found = fit_weights(MOMENTS, start, influences=3, allowed=allowed)
    assert (found[:, 0] == 0).all()
    np.testing.assert_allclose(found.sum(axis=1), 1)
