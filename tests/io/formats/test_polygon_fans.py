"""Polygons as fans of triangles."""

import numpy as np

from garment_jax.io.formats.polygon_fans import fan_corners


def test_fans_are_those_of_a_loop():
    counts, expected, first = [3, 5, 2, 4, 0], [], 0
    for count in counts:
        expected += [[first, first + k, first + k + 1] for k in range(1, count - 1)]
        first += count
    assert fan_corners(np.array(counts)).tolist() == expected
    assert fan_corners(np.zeros(0, np.int32)).shape == (0, 3)
