"""Settings of the collision solver (section 3.5)."""

from typing import NamedTuple


class CollisionOptions(NamedTuple):
    """Settings of the solver. Lengths in metres; all may be traced but `sizes`."""

    eps: float = 1e-3  # margin outside the body
    slack: float = 0.05  # part of the margin, 0 to 1, that may be missing: the surface's curvature, float32
    reach: float = 2e-3  # vertices so much beyond the margin are kept from the body from the first step
    iterations: int = 20  # gradient steps at most
    refresh_every: int = 10  # gradient steps between two searches for correspondences
    tolerance: float = 5e-4  # largest movement between two searches that counts as standing still
    projections: int = 8  # projections at the end at most, each with new correspondences
    rings: int = 4  # edges from a contact to the last vertex that may move
    sizes: tuple[float, ...] = (
        0.09,
        0.18,
        0.27,
        0.36,
    )  # of regions, in parts of the garment; beyond: all of it
