"""The time left of everything, said in each line of progress."""

import time
from collections.abc import Callable, Mapping

from garment_jax.progress import duration


class TimeLeft:
    """What remains of parts that follow each other, from what each was planned to take, in seconds."""

    def __init__(self, planned: Mapping[str, float], *, clock: Callable[[], float] = time.monotonic) -> None:
        self._planned, self._clock = dict(planned), clock
        self.begin(next(iter(self._planned)))

    def plan(self, **seconds: float) -> None:
        """Plan parts anew, once more is known; new ones come before the last part."""
        *first, last = self._planned
        names = [*first, *(name for name in seconds if name not in self._planned), last]
        self._planned = {name: seconds.get(name, self._planned.get(name, 0.0)) for name in names}

    def begin(self, part: str) -> None:
        """Say which part is begun."""
        self._part, self._began = part, self._clock()

    def __call__(self, name: str = "", left: float = 0.0) -> str:
        """Return the time left where `name`, a part or a piece of the present one, has `left` seconds."""
        if name in self._planned:
            if name != self._part:
                self.begin(name)
        else:
            left = max(left, self._planned[self._part] - (self._clock() - self._began))
        names = list(self._planned)
        later = sum(self._planned[part] for part in names[names.index(self._part) + 1 :])
        return f"all: {duration(left + later)} left"
