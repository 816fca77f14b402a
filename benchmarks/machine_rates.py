"""What this machine can do: FLOPs a second of a matrix product, bytes a second of reading memory."""

import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

SIDE = 1024  # of the matrices: as large as the largest products here, and all in the cache


def median_seconds(f: Callable, *arguments, repeats: int = 9) -> float:
    """Return the median time of `f`, compiled by a call that does not count."""
    jax.block_until_ready(f(*arguments))
    seconds = []
    for _ in range(repeats):
        began = time.perf_counter()
        jax.block_until_ready(f(*arguments))
        seconds.append(time.perf_counter() - began)
    return float(np.median(seconds))


def matmul_rate() -> float:
    """Return the FLOPs a second of a product of two float32 matrices."""
    A = jnp.ones((SIDE, SIDE))
    return 2.0 * SIDE**3 / median_seconds(jax.jit(jnp.matmul), A, A)


def read_rate(size: float) -> float:
    """Return the bytes a second at which `size` bytes of float32 are read and summed.

    Of what a model's parameters take: some machines keep that much in the cache from frame to frame.
    """
    x = jnp.ones(max(int(size) // 4, 1024))
    return x.nbytes / median_seconds(jax.jit(jnp.sum), x)
