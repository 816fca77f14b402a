"""Losses of the garment generative model (paper 3.2), every weighted term by name.

Geometric terms are mean squared centimetres over vertices: in squared metres the KL term switches almost
every latent dimension off. The paper's plain 2-norm over the whole mesh is `norm="plain"`.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.config import GenerativeConfig
from garment_jax.dataset.template import Template
from garment_jax.geometry.laplacian import laplacian
from garment_jax.model.generative.network import Code, Decoded

LIVE_NATS = 0.01  # a latent dimension counts as alive above this mean KL


def size_of(E: Float[Array, "*b n 3"], norm: str = "cm2") -> Float[Array, "*b"]:
    """Return the size of the difference `E` (metres): its mean square in cm2 over vertices, or its norm.

    `norm="plain"` is ||E||_2 over the whole mesh in cm, with a gradient of 0 at E = 0.
    """
    square = 1e4 * jnp.square(E).sum(axis=(-2, -1))
    if norm == "cm2":
        return square / E.shape[-2]
    return jnp.where(square == 0, 0.0, jnp.sqrt(jnp.where(square == 0, 1.0, square)))


def kl_per_dimension(code: Code) -> Float[Array, "*b latent"]:
    """Return the KL divergence of each latent dimension from N(0, 1), nats."""
    variance = jnp.exp(code.log_variance)
    return 0.5 * (jnp.square(code.mean) + variance - 1.0 - code.log_variance)


def generative_terms(
    code: Code,
    decoded: Decoded,
    V_star: Float[Array, "*b n 3"],
    T_tilde_star: Float[Array, "*b n 3"],
    *,
    template: Template,
    config: GenerativeConfig,
) -> dict[str, jax.Array]:
    """Return the weighted terms of L = L_geo + L_rec + L_reg for each frame; their sum is the loss.

    Without decomposition there is no unposed garment to compare: L_geo and the KL term alone.
    """
    E = decoded.V - V_star
    offset = decoded.T_tilde - jnp.broadcast_to(template.T, decoded.T_tilde.shape)
    terms = {
        "vertex": size_of(E, config.norm),
        # the operator is linear: one Laplacian of the difference instead of two
        "laplacian": config.lambda_laplacian * size_of(laplacian(E, template.laplacian), config.norm),
        "unposed": config.lambda_unposed * size_of(decoded.T_tilde - T_tilde_star, config.norm),
        "template": config.lambda_template * size_of(offset, config.norm),
        "kl": config.lambda_kl * kl_per_dimension(code).sum(axis=-1),
    }
    return terms if config.decomposition else {k: terms[k] for k in ("vertex", "laplacian", "kl")}
