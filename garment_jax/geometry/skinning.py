"""Softmax skinning by seed points and its damped inverse (paper 3.2; method, "Garment generative model")."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

DAMPING = 1e-3  # relative to the blended matrix' singular values, which are near 1 when well posed


class Unskinned(NamedTuple):
    """An unposed garment and how well posed its inverse was."""

    T_tilde: jax.Array  # [n, 3] metres, canonical
    W: jax.Array  # [n, m]
    condition: jax.Array  # [n] Frobenius condition of the blended matrix, 1 for a rotation


def softmax_weights(
    T_tilde: Float[Array, "n 3"], seeds: Float[Array, "m 3"], *, tau: float
) -> Float[Array, "n m"]:
    """Return W: the softmax of -d / tau over the canonical `seeds`, `tau` in metres.

    `jax.nn.softmax` subtracts the largest exponent, so a garment 10 m away still gets rows that sum
    to 1. The distance's gradient at 0 is 0.
    """
    square = jnp.square(T_tilde[:, None] - seeds[None]).sum(axis=-1)
    zero = square == 0
    distance = jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, square)))
    return jax.nn.softmax(-distance / tau, axis=-1)


def _blend(W: jax.Array, R_seed: jax.Array, t_seed: jax.Array) -> tuple[jax.Array, jax.Array]:
    matrices = (W @ R_seed.reshape(-1, 9)).reshape(-1, 3, 3)
    return matrices, W @ t_seed


def skin(
    T_tilde: Float[Array, "n 3"],
    W: Float[Array, "n m"],
    R_seed: Float[Array, "m 3 3"],
    t_seed: Float[Array, "m 3"],
) -> Float[Array, "n 3"]:
    """Return the unposed garment carried by its seeds: sum_j W_ij (R_j x_i + t_j), metres."""
    A, b = _blend(W, R_seed, t_seed)
    return (A * T_tilde[:, None, :]).sum(axis=-1) + b


def _damped_inverse(A: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Return (A^T A + d^2 I)^-1 A^T and the condition number of `A` `[n, 3, 3]`.

    Closed form by the adjugate: opposite rotations blend to a singular matrix, and then the damping
    bounds the result instead of a NaN.
    """
    At = jnp.swapaxes(A, -1, -2)
    N = (A[:, :, :, None] * A[:, :, None, :]).sum(axis=1) + DAMPING**2 * jnp.eye(3, dtype=A.dtype)
    a, b, c = N[:, 0, 0], N[:, 0, 1], N[:, 0, 2]
    d, e, f = N[:, 1, 1], N[:, 1, 2], N[:, 2, 2]
    cofactors = [d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b]
    C = jnp.stack([cofactors[k] for k in (0, 1, 2, 1, 3, 4, 2, 4, 5)], axis=-1).reshape(-1, 3, 3)
    det = a * cofactors[0] + b * cofactors[1] + c * cofactors[2]
    N_inverse = C / jnp.maximum(det, DAMPING**6)[:, None, None]
    inverse = (N_inverse[:, :, :, None] * At[:, None, :, :]).sum(axis=2)
    norm = jnp.sqrt(jnp.square(A).sum((-1, -2)) * jnp.square(inverse).sum((-1, -2)))
    return inverse, norm / 3.0


def unskin(
    V: Float[Array, "n 3"],
    W: Float[Array, "n m"],
    R_seed: Float[Array, "m 3 3"],
    t_seed: Float[Array, "m 3"],
) -> tuple[Float[Array, "n 3"], Float[Array, " n"]]:
    """Return the unposed garment for given weights (the inverse of `skin`) and its condition `[n]`.

    Where the blended matrix is well conditioned the damping moves a vertex by 1e-6 of its distance
    from the root; where opposite rotations meet the result is finite and the condition large.
    """
    A, b = _blend(W, R_seed, t_seed)
    inverse, condition = _damped_inverse(A)
    return (inverse * (V - b)[:, None, :]).sum(axis=-1), condition


def unskin_fixed_point(
    V: Float[Array, "n 3"],
    T: Float[Array, "n 3"],
    seeds: Float[Array, "m 3"],
    R_seed: Float[Array, "m 3 3"],
    t_seed: Float[Array, "m 3"],
    *,
    tau: float,
    iterations: int = 3,
) -> Unskinned:
    """Return T_tilde_star: W needs T_tilde and T_tilde needs W, so iterate from the template `T`.

    All positions in metres; `V` in the root frame, `T` and `seeds` canonical with the same origin.
    """
    T_tilde, condition, W = T, jnp.ones(len(T), V.dtype), softmax_weights(T, seeds, tau=tau)
    for k in range(iterations):
        W = W if k == 0 else softmax_weights(T_tilde, seeds, tau=tau)
        T_tilde, condition = unskin(V, W, R_seed, t_seed)
    return Unskinned(T_tilde, W, condition)


unskin_sequence = jax.vmap(unskin, in_axes=(0, None, 0, 0))
