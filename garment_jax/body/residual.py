"""How far a fitted body is from its vertices, counted by windows (a long clip's distances need not fit)."""

from typing import NamedTuple

import numpy as np

_STEP = 0.005  # cm, width of a bin
_BINS = 40_000  # up to 2 m


class Residual(NamedTuple):
    """Distances between vertices and the fitted rig over all vertices and frames, cm."""

    mean: float
    p99: float  # 99 of 100 are below it (to 0.05 mm)
    largest: float
    frame: int  # of the largest

    def __str__(self) -> str:
        return (
            f"{self.mean:.2f} cm in the mean, below {self.p99:.2f} cm for 99 of 100 vertices, "
            f"{self.largest:.2f} cm at most (frame {self.frame})"
        )


class ResidualCounter:
    """Counts distances window after window; `result` says what they were."""

    def __init__(self) -> None:
        self._bins = np.zeros(_BINS, np.int64)
        self._sum, self._count, self._frames = 0.0, 0, 0
        self._largest, self._frame = 0.0, 0

    def add(self, distances: np.ndarray) -> None:
        """Count the `distances` `[k, n]` (metres) of the next k frames."""
        cm = 100.0 * distances.astype(np.float64)
        self._bins += np.bincount(np.minimum(cm / _STEP, _BINS - 1).astype(int).ravel(), minlength=_BINS)
        if cm.max() > self._largest:
            self._largest, self._frame = float(cm.max()), self._frames + int(cm.max(axis=1).argmax())
        self._sum, self._count = self._sum + float(cm.sum()), self._count + cm.size
        self._frames += len(cm)

    def result(self) -> Residual:
        """Return the figures of all distances so far (at least one)."""
        below = np.cumsum(self._bins) >= 0.99 * self._count
        p99 = min((int(below.argmax()) + 1) * _STEP, self._largest)
        return Residual(self._sum / self._count, p99, self._largest, self._frame)
