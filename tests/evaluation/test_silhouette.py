import numpy as np
import pytest

from garment_jax.evaluation.silhouette import silhouette_cm2

BOX_FACES = np.array([[0, 1, 2], [1, 3, 2], [4, 6, 5], [5, 6, 7], [0, 4, 1], [1, 4, 5]])


def _box(x, y, z):
    """Corners of a box (front, back and bottom faces), metres."""
    return np.array([[i * x, j * y, k * z] for k in (0, 1) for j in (0, 1) for i in (0, 1)], float)


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, 0.7])
def test_a_sheet_covers_its_width_times_the_cosine(yaw):
    sheet = _box(0.4, 0.6, 0.0)[:4]
    expected = 1e4 * 0.6 * 0.4 * (abs(np.cos(yaw)) + abs(np.sin(yaw))) / 2
    assert silhouette_cm2(sheet, BOX_FACES[:2], yaw) == pytest.approx(expected, rel=0.02)


def test_what_lies_behind_is_not_counted_twice():
    box, faces = _box(0.4, 0.6, 0.3), BOX_FACES
    doubled = silhouette_cm2(np.concatenate([box, box]), np.concatenate([faces, faces + 8]), 0.3)
    assert doubled == silhouette_cm2(box, faces, 0.3)
