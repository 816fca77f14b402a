"""The first frame's garment when nobody gives one: the template carried by its seeds."""

from collections.abc import Callable

import jax
import numpy as np

from garment_jax.body.seeds import Seeds
from garment_jax.geometry.skinning import skin, softmax_weights


def make_skinned_template(T: np.ndarray, seeds: Seeds, tau: float) -> Callable[..., jax.Array]:
    """Return a jitted function (R_seed `[k, m, 3, 3]`, t_seed `[k, m, 3]`) -> `[k, n, 3]`, root frames."""
    W = np.asarray(jax.jit(lambda T, points: softmax_weights(T, points, tau=tau))(T, seeds.points))

    def pose(T: jax.Array, W: jax.Array, R_seed: jax.Array, t_seed: jax.Array) -> jax.Array:
        return jax.vmap(lambda R, t: skin(T, W, R, t))(R_seed, t_seed)

    compiled = jax.jit(pose)
    return lambda R_seed, t_seed: compiled(T, W, R_seed, t_seed)
