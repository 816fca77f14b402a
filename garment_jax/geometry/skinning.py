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
    matrices = W @ R_seed.reshape(*R_seed.shape[:-2], 9)
    return matrices.reshape(*matrices.shape[:-1], 3, 3), W @ t_seed


def skin(
    T_tilde: Float[Array, "*b n 3"],
    W: Float[Array, "n m"],
    R_seed: Float[Array, "*b m 3 3"],
    t_seed: Float[Array, "*b m 3"],
) -> Float[Array, "*b n 3"]:
    """Return the unposed garment carried by its seeds or joints: sum_j W_ij (R_j x_i + t_j), metres."""
    A, b = _blend(W, R_seed, t_seed)
    return (A * T_tilde[..., None, :]).sum(axis=-1) + b


def _damped_inverse(A: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Return (A^T A + d^2 I)^-1 A^T and the condition number of `A` `[n, 3, 3]`.

    Opposite rotations blend to a singular matrix; the damping then bounds the result by 1 / 2d. In closed
    form by adj(A) and det(A): with M = A^T A, adj(M + d^2 I) = adj(M) + d^2 (tr(M) I - M) + d^4 I and
    det(M + d^2 I) = det(A)^2 + d^2 |adj(A)|^2 + d^4 tr(M) + d^6. All terms are positive: cofactors taken
    of the damped M itself cancel in float32 and leave 1e10 metres. The condition is Frobenius', of the
    damped matrix, with a rotation's norm as the least (a matrix of zeros is not well posed).
    """
    d2, At = DAMPING**2, jnp.swapaxes(A, -1, -2)
    columns = [jnp.cross(A[:, 1], A[:, 2]), jnp.cross(A[:, 2], A[:, 0]), jnp.cross(A[:, 0], A[:, 1])]
    adjugate = jnp.stack(columns, axis=-1)
    det = (A[:, 0] * columns[0]).sum(axis=-1)[:, None, None]
    square = jnp.square(A).sum((-1, -2), keepdims=True)
    square_adjugate = jnp.square(adjugate).sum((-1, -2), keepdims=True)
    total = det**2 + d2 * square_adjugate + d2**2 * square + d2**3
    AAt = (A[:, :, None, :] * A[:, None, :, :]).sum(axis=-1)
    MAt = (At[:, :, :, None] * AAt[:, None, :, :]).sum(axis=2)
    inverse = (det * adjugate + d2 * (square * At - MAt) + d2**2 * At) / total
    trace_inverse = (square_adjugate + 2 * d2 * square + 3 * d2**2) / total
    norm = jnp.sqrt(jnp.maximum(square + 3 * d2, 3.0) * trace_inverse)[:, 0, 0]
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


@jax.jit
def unskin_frames(V: jax.Array, W: jax.Array, R: jax.Array, t: jax.Array) -> jax.Array:
    """Return the frames `V` `[k, n, 3]` (root frames) in canonical pose, by the damped inverse of `skin`."""
    return unskin_sequence(V, W, R, t)[0]
