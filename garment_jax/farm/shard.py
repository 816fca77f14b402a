"""One part of the jobs of a command, for the job arrays of a cluster's queue."""

import re
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

T = TypeVar("T")


class Shard(NamedTuple):
    """Part `number` of `count`; the parts are apart, and together all."""

    number: int  # from 1
    count: int

    def of(self, jobs: Sequence[T]) -> list[T]:
        """Return every `count`-th job from the `number`-th: neighbours, often alike in length, go apart."""
        return list(jobs[self.number - 1 :: self.count])

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"


def parse_shard(text: str) -> Shard:
    """Return the part that "3/16" names; `ValueError` for what is none."""
    found = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text.strip())
    if found is None or not 1 <= int(found[1]) <= int(found[2]):
        raise ValueError(f"--shard {text} is no part; give NUMBER/COUNT, from 1/16 to 16/16 of sixteen.")
    return Shard(int(found[1]), int(found[2]))
