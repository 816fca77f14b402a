"""Labels of a crowd of points: beside their own point, over no mark and over no other label."""

import numpy as np

from garment_jax.bench.labels import MARK, RINGS, place_labels


def boxes(
    points: np.ndarray, offsets: np.ndarray, size: tuple[float, float]
) -> list[tuple[np.ndarray, np.ndarray]]:
    centre = points + offsets
    return [(c - np.array(size) / 2, c + np.array(size) / 2) for c in centre]


def apart(a: tuple[np.ndarray, np.ndarray], b: tuple[np.ndarray, np.ndarray]) -> bool:
    return bool((a[1] <= b[0] + 1e-9).any() or (b[1] <= a[0] + 1e-9).any())


def test_a_lone_label_is_up_to_the_right():
    for size in ((5.0, 5.0), (8.0, 6.0), (11.0, 8.0)):
        (offset,) = place_labels([(100.0, 50.0)], [size])
        assert offset.min() > 0
        assert np.linalg.norm(offset) <= RINGS[1] + 1e-9


def test_nothing_is_covered_in_a_crowd():
    rng = np.random.default_rng(3)
    points = np.concatenate([rng.uniform(0, 40, (12, 2)), rng.uniform(0, 400, (12, 2))])
    offsets = place_labels([tuple(p) for p in points], [(11.0, 8.0)] * len(points))
    assert np.linalg.norm(offsets, axis=1).max() <= RINGS[-1] + 1e-9
    placed = boxes(points, offsets, (11.0, 8.0))
    marks = boxes(points, np.zeros_like(points), (2 * MARK, 2 * MARK))
    assert all(apart(a, b) for i, a in enumerate(placed) for b in placed[:i])
    assert all(apart(a, b) for a in placed for b in marks)


def test_where_there_is_no_room_the_least_is_covered():
    points = [(0.0, 0.0)] * 200
    offsets = place_labels(points, [(11.0, 8.0)] * 200)
    assert np.isfinite(offsets).all()
    assert len({tuple(np.round(o, 6)) for o in offsets}) > 40


def test_no_points_no_labels():
    assert place_labels([], []).shape == (0, 2)
