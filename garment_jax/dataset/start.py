"""The first frame's garment when nobody gives one: the template carried by its seeds."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.body.seeds import Seeds
from garment_jax.dataset.template import Template
from garment_jax.geometry.skinning import skin, softmax_weights


def make_skinned_template(T: np.ndarray, seeds: Seeds, tau: float) -> Callable[..., jax.Array]:
    """Return a jitted function (R_seed `[k, m, 3, 3]`, t_seed `[k, m, 3]`) -> `[k, n, 3]`, root frames."""
    W = np.asarray(jax.jit(lambda T, points: softmax_weights(T, points, tau=tau))(T, seeds.points))

    def pose(T: jax.Array, W: jax.Array, R_seed: jax.Array, t_seed: jax.Array) -> jax.Array:
        return jax.vmap(lambda R, t: skin(T, W, R, t))(R_seed, t_seed)

    compiled = jax.jit(pose)
    return lambda R_seed, t_seed: compiled(T, W, R_seed, t_seed)


def make_start(template: Template, seeds: Seeds, tau: float) -> Callable[..., jax.Array]:
    """Return a function as `make_skinned_template` does, of the same template in the networks' frame.

    In canonical pose a carried template is the template itself.
    """
    if template.W is None:
        return make_skinned_template(template.T, seeds, tau)
    T = jnp.asarray(template.T)
    return lambda R_seed, t_seed: jnp.broadcast_to(T, (len(R_seed), *T.shape))
