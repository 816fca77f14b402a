"""How far two triangles are apart as the toolkit of Incremental Potential Contact has it."""

from itertools import product

import ipctk
import numpy as np


def triangle_distance(one: np.ndarray, other: np.ndarray) -> float:
    """Return the distance of two triangles `[3, 3]` that do not cross, in their unit."""
    one, other = one.astype(np.float64), other.astype(np.float64)
    sides = [(0, 1), (1, 2), (2, 0)]
    squared = [ipctk.point_triangle_distance(p, *t) for a, t in ((one, other), (other, one)) for p in a]
    squared += [ipctk.edge_edge_distance(*one[list(a)], *other[list(b)]) for a, b in product(sides, sides)]
    return float(np.sqrt(min(squared)))
