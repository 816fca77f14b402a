"""What this machine can do: FLOPs a second of a matrix product, bytes a second of reading memory."""

import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

ROWS, READS = (
    512,
    8,
)  # of the matrix that is read, and how often: one read of a small one is shorter than a call
SIDE = 1024  # of the matrices: as large as the largest products here, and all in the cache


def median_seconds(f: Callable, *arguments, repeats: int = 9) -> float:
    """Return the median time of `f`, compiled by a call that does not count."""
    return float(np.median(_seconds(f, arguments, repeats)))


def best_seconds(f: Callable, *arguments, repeats: int = 15) -> float:
    """Return the shortest time of `f` after a call that compiles: a limit is what is possible."""
    return min(_seconds(f, arguments, repeats))


def _seconds(f: Callable, arguments: tuple, repeats: int) -> list[float]:
    jax.block_until_ready(f(*arguments))
    seconds = []
    for _ in range(repeats):
        began = time.perf_counter()
        jax.block_until_ready(f(*arguments))
        seconds.append(time.perf_counter() - began)
    return seconds


def matmul_rate() -> float:
    """Return the FLOPs a second of a product of two float32 matrices."""
    A = jnp.ones((SIDE, SIDE))
    return 2.0 * SIDE**3 / best_seconds(jax.jit(jnp.matmul), A, A)


def read_rate(size: float) -> float:
    """Return the bytes a second at which a matrix of `size` bytes is read for a product with a vector.

    Small ones come from the cache, again and again, as the parameters of a stage that is timed by itself do.
    """
    A = jnp.ones((ROWS, max(int(size) // (4 * ROWS), 16)))
    run = jax.jit(
        lambda x, A: jax.lax.scan(lambda x, _: (0.5 * x + (x @ A)[:1], None), x, None, length=READS)[0]
    )
    return READS * A.nbytes / best_seconds(run, jnp.ones(ROWS), A)
