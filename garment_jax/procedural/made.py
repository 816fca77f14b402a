"""What every garment maker returns, and the check on how fine it is to be."""

from typing import NamedTuple

import numpy as np

from garment_jax.structs import Garment, Pins

FEWEST, MOST = 100, 100_000


class MadeGarment(NamedTuple):
    """A garment, its pins and its flat pattern (static)."""

    garment: Garment
    pins: Pins
    pattern: np.ndarray | None  # [u, 2] metres, a point for each UV, counter-clockwise; None: not developable


def check_count(vertices: int) -> None:
    """Raise ValueError unless `vertices` is a number of vertices that a garment can be made of."""
    if not FEWEST <= vertices <= MOST:
        raise ValueError(
            f"--vertices {vertices} must lie between {FEWEST} and {MOST}; 900 makes a light one."
        )
