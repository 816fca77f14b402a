"""A numeric routine on a problem of one size, and its errors in float32 and bfloat16 against float64.

The inputs are the same numbers, first rounded to the type under test: what counts is what the routine adds.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np


class Routine(NamedTuple):
    """A routine on a problem of one size; `f` takes trees of arrays of any floating type."""

    name: str
    size: int
    f: Callable[..., Any]
    inputs: tuple[Any, ...]  # trees of float64 arrays
    scale: float  # from the result's unit (metres, or 1) to the table's
    unit: str
    bound: float  # of the error in float32, in the table's unit
    reference: Callable[..., np.ndarray] | None = None  # where float64 is computed elsewhere
    half: bool = True  # whether it runs in bfloat16 at all


class Errors(NamedTuple):
    """Largest errors of one routine over its sizes, in the table's unit."""

    sizes: list[int]
    single: list[float]
    half: list[float]  # empty where it does not run in bfloat16


def errors_of(routines: list[Routine]) -> Errors:
    """Return the errors of one routine at its sizes."""
    single = [_error(routine, jnp.float32) for routine in routines]
    half = [_error(routine, jnp.bfloat16) for routine in routines if routine.half]
    return Errors([routine.size for routine in routines], single, half)


def _error(r: Routine, kind: Any) -> float:
    """Return the largest error of arithmetic in `kind`, of which the inputs are numbers."""
    rounded = jax.tree.map(lambda x: np.asarray(x, kind), r.inputs)
    double = jax.tree.map(lambda x: x.astype(np.float64), rounded)
    found = np.asarray(jax.jit(r.f)(*rounded), np.float64)
    if r.reference is None:
        with jax.enable_x64(True):
            exact = np.asarray(jax.jit(r.f)(*double))
    else:
        exact = r.reference(*double)
    return r.scale * float(np.abs(found - exact).max())


def typed(tables: Any, like: jax.Array) -> Any:
    """Return static tables with their weights in the type of `like`: a float32 weight would promote."""

    def cast(x: Any) -> Any:
        return jnp.asarray(x, like.dtype) if getattr(x, "dtype", None) == np.float32 else x

    return jax.tree.map(cast, tables)
