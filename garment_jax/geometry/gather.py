"""Gathers and scatters that stay apart: XLA would fuse into a gather what makes its operand or its indices.

There it is computed anew for every number gathered.
"""

from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from garment_jax.geometry.noinline import noinline

T = TypeVar("T")


@noinline
def gathered(whole: T, places: Int[Array | np.ndarray, "*k"]) -> T:
    """Return the `places` of the last axis of every array of a tree."""
    return jax.tree.map(lambda x: x[..., jnp.asarray(places)], whole)


@noinline
def scattered(whole: T, part: T, places: Int[Array, " k"]) -> T:
    """Return a tree's arrays with those of `part` written to the `places` of the last axis, if they exist."""
    return jax.tree.map(lambda x, y: x.at[..., places].set(y, mode="drop"), whole, part)


@noinline
def coordinates_of(rows: Int[Array | np.ndarray, "*k"], flat: Float[Array, " c3"]) -> Array:
    """Return the coordinates `[3, *k]` of these vertices, of all coordinates one after the other.

    Where tables name them, give those as they are, in NumPy: XLA computes what is made of a constant, a
    transpose, a sum, anew for every number gathered.
    """
    return numbers_at(rows[None] + first_numbers(flat).reshape(3, *(1 for _ in rows.shape)), flat)


def first_numbers(flat: Array) -> np.ndarray:
    """Return where each coordinate's numbers begin in `flat`."""
    return np.int32(len(flat) // 3) * np.arange(3, dtype=np.int32)


def numbers_at(places: Array | np.ndarray, flat: Array) -> Array:
    """Return the numbers of `flat` at places that exist."""
    return flat.at[jnp.asarray(places)].get(mode="promise_in_bounds", wrap_negative_indices=False)
