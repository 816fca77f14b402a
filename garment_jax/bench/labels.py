"""Where the numbers beside a plot's points stand, so that those of a crowd can be told apart."""

from collections.abc import Sequence

import numpy as np

RINGS = (8.0, 14.0, 22.0, 32.0, 44.0)  # distances from a point that are tried, in the points' unit
DIRECTIONS = 12
FIRST = np.pi / 4  # up and to the right, where a reader looks first
MARK = 4.0  # half the size of a point's mark


def place_labels(points: Sequence[tuple[float, float]], sizes: Sequence[tuple[float, float]]) -> np.ndarray:
    """Return the centre of each label relative to its point `[k, 2]`, as near as there is room.

    `points` and `sizes` (width, height of a label) in one unit, such as pixels. One after the other takes
    the first place that covers no mark and no label; where there is none, the one that covers least.
    """
    marks = [(x, y, 2 * MARK, 2 * MARK) for x, y in points]
    taken: list[tuple[float, float, float, float]] = []
    offsets = np.zeros((len(marks), 2))
    for k, ((x, y), (w, h)) in enumerate(zip(points, sizes, strict=True)):
        tried = [(dx, dy, _covered((x + dx, y + dy, w, h), marks + taken)) for dx, dy in _around()]
        dx, dy, _ = min(tried, key=lambda place: place[2])  # the first of equals is the nearest
        offsets[k] = dx, dy
        taken.append((x + dx, y + dy, w, h))
    return offsets


def _around() -> list[tuple[float, float]]:
    turns = sorted(range(DIRECTIONS), key=lambda k: min(k, DIRECTIONS - k))
    angles = [FIRST + 2 * np.pi * k / DIRECTIONS for k in turns]
    return [(r * float(np.cos(a)), r * float(np.sin(a))) for r in RINGS for a in angles]


def _covered(
    box: tuple[float, float, float, float], others: Sequence[tuple[float, float, float, float]]
) -> float:
    """Return the area that a box (centre, width, height) shares with others."""
    if not others:
        return 0.0
    x, y, w, h = np.array(others).T
    wide = np.minimum(box[0] + box[2] / 2, x + w / 2) - np.maximum(box[0] - box[2] / 2, x - w / 2)
    high = np.minimum(box[1] + box[3] / 2, y + h / 2) - np.maximum(box[1] - box[3] / 2, y - h / 2)
    return float((np.maximum(wide, 0.0) * np.maximum(high, 0.0)).sum())
