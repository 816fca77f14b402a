"""The Pareto front against the definition, point by point."""

import numpy as np

from garment_jax.bench.front import pareto_front


def beaten(i: int, points: list[tuple[float, float]]) -> bool:
    x, y = points[i]
    return any(a <= x and b <= y and (a < x or b < y) for a, b in points)


def test_the_front_is_what_nobody_beats() -> None:
    rng = np.random.default_rng(0)
    for count in (0, 1, 2, 7, 40):
        for _ in range(20):
            grid = rng.integers(0, 6, (count, 2))  # few values: ties in one and in both
            points = [(float(a), float(b)) for a, b in grid]
            slow = {i for i in range(count) if not beaten(i, points)}
            front = pareto_front(points)
            assert set(front) == slow
            assert [points[i][0] for i in front] == sorted(points[i][0] for i in front)
