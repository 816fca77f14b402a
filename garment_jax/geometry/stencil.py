"""A fixed sparse linear operator as padded gathers, forwards and backwards.

The derivative of a gather is a scatter, which XLA runs one element after the other on a CPU (five
times the forward pass, measured on the shared skirt). The operator never changes, so its transpose is made
once and the backward pass is a gather too. Laplacian and UV maps are such operators. Two Laplacians
are written anew where this one is too slow: `elastic` in bands, with the coordinates first and the neighbours
gathered once for the edges as well; `postprocess.collision.region` on the few vertices that a frame moves.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.geometry.noinline import fusion_barrier


class Stencil(NamedTuple):
    """y_i = sum_k weight[i, k] x[index[i, k]], and its transpose (static)."""

    index: np.ndarray  # [m, k] int32 into the n inputs; padding has weight 0
    weight: np.ndarray  # [m, k] float32
    index_t: np.ndarray  # [n, k'] int32 into the m outputs
    weight_t: np.ndarray  # [n, k'] float32


def make_stencil(index: np.ndarray, weight: np.ndarray, columns: int) -> Stencil:
    """Return the operator with rows `index`, `weight` `[m, k]` on `columns` inputs, and its transpose."""
    rows = np.repeat(np.arange(len(index)), index.shape[1])
    keep = weight.ravel() != 0
    row, column, value = rows[keep], index.ravel()[keep], weight.ravel()[keep]
    order = np.argsort(column, kind="stable")
    row, column, value = row[order], column[order], value[order]
    count = np.bincount(column, minlength=columns)
    slot = np.arange(len(column)) - np.repeat(np.cumsum(count) - count, count)
    index_t = np.zeros((columns, max(int(count.max(initial=0)), 1)), np.int32)
    weight_t = np.zeros(index_t.shape, np.float32)
    index_t[column, slot], weight_t[column, slot] = row, value
    return Stencil(index.astype(np.int32), weight.astype(np.float32), index_t, weight_t)


def dense_matrix(stencil: Stencil, columns: int) -> np.ndarray:
    """Return the operator as a matrix `[m, columns]` float32."""
    out = np.zeros((len(stencil.index), columns), np.float32)
    np.add.at(out, (np.arange(len(out))[:, None], stencil.index), stencil.weight)
    return out


@jax.custom_vjp
def apply_stencil(x: jax.Array, stencil: Stencil) -> jax.Array:
    """Return the operator applied to `x` `[*b, n, c]`, `[*b, m, c]`; differentiable in `x` alone."""
    return _gather(x, stencil.index, stencil.weight)


def _gather(x: jax.Array, index: np.ndarray | jax.Array, weight: np.ndarray | jax.Array) -> jax.Array:
    each = weight.reshape((1,) * (x.ndim - 2) + (*weight.shape, 1))
    return (jnp.take(fusion_barrier(x), index, axis=-2, mode="clip") * each).sum(axis=-2)


def _forward(x: jax.Array, stencil: Stencil) -> tuple[jax.Array, Stencil]:
    return apply_stencil(x, stencil), stencil


def _backward(stencil: Stencil, gradient: jax.Array) -> tuple[jax.Array, None]:
    return _gather(gradient, stencil.index_t, stencil.weight_t), None


apply_stencil.defvjp(_forward, _backward)
