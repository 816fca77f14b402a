"""Errors that are the same, opposite, or have nothing to do with each other."""

import numpy as np
import pytest

from tests.benchmarks.scripts import script

agreement = script("agreement")


def test_the_correlation_is_the_cosine_between_errors():
    E = np.random.default_rng(0).normal(size=(4, 5, 3)).astype(np.float32)
    across = np.zeros_like(E)
    across[..., 0], across[..., 1] = -E[..., 1], E[..., 0]  # turned by 90 degrees in every vertex
    E[..., 2] = 0
    assert agreement.correlation(E, 3 * E) == pytest.approx(1.0)
    assert agreement.correlation(E, -E) == pytest.approx(-1.0)
    assert agreement.correlation(E, across) == pytest.approx(0.0, abs=1e-6)
    assert agreement.correlation(E, np.zeros_like(E)) == 0.0


@pytest.mark.parametrize("c", [-0.5, 0.0, 0.8])
def test_the_mean_of_two_equal_errors_is_as_good_as_the_docstring_says(c: float):
    a, b = np.zeros((1, 1, 3)), np.zeros((1, 1, 3))
    a[..., 0] = 0.05
    b[..., 0], b[..., 1] = 0.05 * c, 0.05 * np.sqrt(1 - c * c)
    row = agreement.pair_row("clip", ("a", "b"), a, b)
    assert row["RMSE cm"] == "5.00 / 5.00"
    assert row["correlation"] == pytest.approx(c)
    assert row["mean of both"] == pytest.approx(5 * np.sqrt((1 + c) / 2), abs=0.006)
