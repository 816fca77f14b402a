"""Losses of the dynamic motion encoder (paper 3.3), every weighted term by name."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.config import MotionConfig
from garment_jax.dataset.template import Template
from garment_jax.geometry.laplacian import laplacian
from garment_jax.model.generative.losses import size_of


def motion_terms(
    V: Float[Array, "*b n 3"],
    V_star: Float[Array, "*b n 3"],
    Z: Float[Array, "*b latent"],
    Z_star: Float[Array, "*b latent"],
    *,
    template: Template,
    config: MotionConfig,
) -> dict[str, jax.Array]:
    """Return the weighted terms of L = L_geo + L_z for each frame (metres in, squared cm out)."""
    E = V - V_star
    latent = jnp.square(Z - Z_star).mean(axis=-1)
    return {
        "vertex": size_of(E, config.norm),
        "laplacian": config.lambda_laplacian * size_of(laplacian(E, template.laplacian), config.norm),
        "latent": config.lambda_latent * latent,
    }
