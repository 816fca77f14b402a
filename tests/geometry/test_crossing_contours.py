"""Pushes along which the lines of crossing grow shorter, by those lines' length in float64."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.geometry.crossing_contours import make_contour_tables, shorter_contours
from garment_jax.geometry.self_crossings import find_self_crossings, make_crossing_tables
from tests.postprocess.sheets import TWO_FACES, two_sheets


@lru_cache
def pushed():
    crossings = make_crossing_tables(two_sheets(0.0), TWO_FACES)
    tables = make_contour_tables(TWO_FACES, crossings)
    return jax.jit(lambda V: shorter_contours(V, find_self_crossings(V, crossings), tables))


def contour_length(V: np.ndarray) -> float:
    """Return the length of all lines in which two faces without a common vertex meet, metres."""
    V = V.astype(np.float64)
    low, high = V[TWO_FACES].min(axis=1), V[TWO_FACES].max(axis=1)
    total = 0.0
    for i in range(len(TWO_FACES)):
        near = np.flatnonzero(
            (low[i] <= high).all(1) & (high[i] >= low).all(1) & (np.arange(len(TWO_FACES)) > i)
        )
        for j in near:
            if not set(TWO_FACES[i]) & set(TWO_FACES[j]):
                total += _meet(V[TWO_FACES[i]], V[TWO_FACES[j]])
    return total


def _meet(a: np.ndarray, b: np.ndarray) -> float:
    """Return the length of the segment in which two triangles meet (Moeller's intervals)."""
    n, m = (np.cross(t[1] - t[0], t[2] - t[0]) for t in (a, b))
    line = np.cross(n, m)
    size = np.linalg.norm(line)
    if size < 1e-12 * np.linalg.norm(n) * np.linalg.norm(m):
        return 0.0
    spans = []
    for triangle, other, normal in ((a, b, m), (b, a, n)):
        side = (triangle - other[0]) @ normal
        if (side >= 0).all() or (side <= 0).all():
            return 0.0
        at = []
        for k in range(3):
            p, q, s, t = triangle[k], triangle[(k + 1) % 3], side[k], side[(k + 1) % 3]
            if s * t < 0:
                at.append((p + (q - p) * s / (s - t)) @ line / size)
        if len(at) < 2:
            return 0.0
        spans.append((min(at), max(at)))
    return max(min(spans[0][1], spans[1][1]) - max(spans[0][0], spans[1][0]), 0.0)


@pytest.mark.parametrize("bump", [0.03, 0.06, 0.1])
def test_a_small_step_makes_the_contours_shorter(bump: float):
    V = two_sheets(bump)
    sums, many = (np.asarray(x) for x in pushed()(V))
    step = 1e-4 * sums / np.maximum(many, 1e-9)[:, None]
    before = contour_length(V)
    assert before > 0.1
    assert contour_length(V + step) < before < contour_length(V - step)


def test_a_bump_is_pushed_back_to_its_side():
    sums, _ = pushed()(two_sheets(0.06))
    above, below = np.asarray(sums)[:, 1].reshape(2, -1).sum(axis=1)
    assert above > 1.0
    assert below < -1.0


def test_edges_push_faces_as_much_as_these_push_them():
    sums, many = (np.asarray(x, np.float64) for x in pushed()(two_sheets(0.06)))
    assert np.abs(sums).max() > 0.1
    np.testing.assert_allclose(sums.sum(axis=0), 0.0, atol=1e-4)
    assert many.sum() / 2 == pytest.approx(round(many.sum() / 2), abs=1e-3)  # an edge and a face each
    assert many.sum() > 20


def test_nothing_is_pushed_where_nothing_crosses():
    sums, many = pushed()(jnp.asarray(two_sheets(0.01)))
    assert not sums.any()
    assert not many.any()
