"""The networks run a chunk ahead of what shapes their chunks, and that ahead of collisions and writing."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

import jax

T = TypeVar("T")


def prefetch(items: Iterator[T]) -> Iterator[T]:
    """Yield `items` in order, the next one being computed on a thread while the caller uses this one.

    Nothing that a rollout feeds back depends on collision handling, so the two overlap. A thread, since JAX
    runs the programs that one thread starts one after the other. At most one item is computed in vain. What
    `items` raises is raised here, in its turn.
    """
    device = jax.config.jax_default_device  # type: ignore[attr-defined]  # this thread's, not the process'

    def compute() -> list[T]:
        with jax.default_device(device):
            return [jax.block_until_ready(item) for item in islice(items, 1)]

    pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="ahead")
    try:
        found = pool.submit(compute).result()
        while found:
            following = pool.submit(compute)
            yield from found
            found = following.result()
    finally:
        pool.shutdown(wait=False)  # who stops here need not wait for a program that is still being compiled
