"""Values spread over a mesh: a strip's closed form, bounds, and what hangs on nothing."""

import numpy as np
import pytest

from garment_jax.geometry.extension import diffused, smooth_extension


def strip(columns: int, rows: int, h: float) -> tuple[np.ndarray, np.ndarray]:
    """A regular triangle strip hanging from y = 0, periodic in x so that it has no sides."""
    i, j = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    index = lambda a, b: (a % columns) * rows + b  # noqa: E731
    angle = 2 * np.pi * (i + 0.5 * (j % 2)) / columns
    radius = h * columns / (2 * np.pi)
    points = np.stack([radius * np.cos(angle), -h * j * np.sqrt(3) / 2, radius * np.sin(angle)], -1)
    faces = []
    for a in range(columns):
        for b in range(rows - 1):
            s = b % 2  # every other row is shifted by half an edge: the grid of equilateral triangles
            p, q, r, t = index(a, b), index(a + 1, b), index(a, b + 1), index(a + 1, b + 1)
            faces += [[p, q, t], [p, t, r]] if s else [[p, q, r], [q, t, r]]
    return points.reshape(-1, 3), np.array(faces)


def test_it_fades_by_e_every_reach():
    points, faces = strip(24, 60, 0.02)
    top = np.arange(24) * 60
    H = smooth_extension(points, faces, top, reach=0.15)
    d = (H @ np.ones((24, 1)))[:60, 0]
    depth, whole = -points[:60, 1], -points[59, 1]
    expected = np.cosh((whole - depth) / 0.15) / np.cosh(whole / 0.15)  # free at the lower rim
    np.testing.assert_allclose(d, expected, atol=0.04)


def test_known_vertices_keep_their_own_and_no_row_exceeds_one():
    points, faces = strip(12, 10, 0.03)
    known = np.array([0, 35, 70])
    H = smooth_extension(points, faces, known, reach=0.2)
    np.testing.assert_array_equal(H[known], np.eye(3))
    assert H.min() >= 0
    assert H.sum(axis=1).max() <= 1 + 1e-6


def test_a_part_that_hangs_on_nothing_stays():
    points, faces = strip(12, 6, 0.03)
    both = np.concatenate([points, points + 5.0])
    H = smooth_extension(both, np.concatenate([faces, faces + len(points)]), np.array([0]), reach=0.2)
    assert H[len(points) :].max() == pytest.approx(0.0, abs=1e-12)
    assert H[1].sum() > 0.3


def test_nothing_known_extends_nothing():
    points, faces = strip(12, 6, 0.03)
    assert smooth_extension(points, faces, np.zeros(0, int), reach=0.2).shape == (len(points), 0)


@pytest.mark.parametrize("reach", [0.05, 0.1])
def test_a_value_spreads_by_reach_in_the_root_mean_square(reach: float):
    points, faces = strip(60, 60, 0.02)
    middle = 30 * 60 + 30
    x = diffused(np.eye(len(points))[:, [middle]], points, faces, reach=reach)[:, 0]
    down = points[:, 1] - points[middle, 1]
    column, row = np.divmod(np.arange(len(points)), 60)
    along = 0.02 * (column - 30 + 0.5 * (row % 2))  # on the cloth and not through the air
    assert np.sqrt((x * (down**2 + along**2)).sum()) == pytest.approx(reach, rel=0.02)


def test_averages_stay_averages():
    points, faces = strip(12, 10, 0.03)
    weights = np.random.default_rng(0).dirichlet(np.ones(3), len(points))
    y = diffused(weights, points, faces, reach=0.2)
    np.testing.assert_allclose(y.sum(axis=1), 1.0, atol=1e-9)
    assert y.min() > weights.min()
    assert y.max() < weights.max()
    np.testing.assert_allclose(y.mean(axis=0), weights.mean(axis=0), atol=1e-9)  # nothing is lost
