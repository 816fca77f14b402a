"""Bands against closed forms: a known rollout of known coefficients, eigenvectors of a strip."""

import numpy as np
import pytest

from tests.benchmarks.scripts import script

bands = script("fold_bands")


def test_the_best_gain_is_the_one_that_a_search_finds():
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(40, 6, 3))
    made = 0.5 * truth + 0.7 * rng.normal(size=truth.shape)
    row = bands.band_row(made, truth, 10)
    gains = np.linspace(0, 2, 2001)
    errors = [np.square(g * made - truth).sum() for g in gains]
    assert row["best gain"] == pytest.approx(gains[int(np.argmin(errors))], abs=0.006)
    assert row["power ratio"] == pytest.approx(np.square(made).sum() / np.square(truth).sum(), abs=0.006)
    assert row["true rms cm"] == pytest.approx(100 * np.sqrt(np.square(truth).sum() / 40 / 10), abs=0.006)
    assert np.square(bands.restored(made, truth)).sum() == pytest.approx(np.square(truth).sum())


def test_eigenvectors_are_orthonormal_and_go_from_smooth_to_fine():
    n = 12  # a strip of triangles: vertices 0 … 11, edges to the next two
    faces = np.array([[i, i + 1, i + 2] for i in range(n - 2)])
    B = bands.eigenvectors(faces, n, 5)
    np.testing.assert_allclose(B.T @ B, np.eye(5), atol=1e-9)
    np.testing.assert_allclose(np.abs(B[:, 0]), 1 / np.sqrt(n), atol=1e-9)
    edges = {(i, j) for i in range(n) for j in (i + 1, i + 2) if j < n}
    heights = [sum((b[i] - b[j]) ** 2 for i, j in edges) for b in B.T]
    assert heights == sorted(heights)
