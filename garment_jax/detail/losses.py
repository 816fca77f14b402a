"""Losses of the detail enhancement (paper 3.4), every weighted term by name.

L1 is the mean over vertices of |x| + |y| + |z| in cm. The paper's plain sum over the mesh is n times that;
as a mean it does not change its weight against the adversarial term with the mesh.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.config import DetailConfig
from garment_jax.data.template import Template
from garment_jax.geometry.laplacian import laplacian

REAL, FAKE = 1.0, -1.0  # the discriminator's targets


def l1_cm(E: Float[Array, "*b n 3"]) -> Float[Array, "*b"]:
    """Return the mean over vertices of the 1-norm of `E` (metres), cm; its gradient is 0 at E = 0."""
    # jnp.abs has a gradient of 1 at 0
    return 100.0 * (E * jnp.sign(E)).sum(axis=-1).mean(axis=-1)


def detail_terms(
    V_f: Float[Array, "*b n 3"],
    V_star: Float[Array, "*b n 3"],
    *,
    template: Template,
    config: DetailConfig,
) -> dict[str, jax.Array]:
    """Return the weighted terms of L_geo for each frame (metres in, cm out)."""
    E = V_f - V_star
    return {
        "vertex": l1_cm(E),
        # the operator is linear: one Laplacian of the difference instead of two
        "laplacian": config.lambda_laplacian * l1_cm(laplacian(E, template.laplacian)),
    }


def score_error(scores: Sequence[jax.Array], target: float) -> jax.Array:
    """Return the mean squared distance of `scores` from `target`: over patches, then over scales.

    So each scale counts alike, the coarse one with 1/16 of the fine one's patches too.
    """
    return jnp.stack([jnp.square(score - target).mean() for score in scores]).mean()


def discriminator_loss(real: Sequence[jax.Array], fake: Sequence[jax.Array]) -> jax.Array:
    """Return L_g, which D_ms minimises: (D(S_star) - 1)^2 + (D(S_f) + 1)^2."""
    return score_error(real, REAL) + score_error(fake, FAKE)


def adversarial_term(fake: Sequence[jax.Array], *, config: DetailConfig) -> jax.Array:
    """Return G_de's own weighted term: its garments' scores pulled to +1.

    The paper writes the same L_g for both, which G_de would "maximise": unbounded, so no weight tames it.
    """
    return config.lambda_adversarial * score_error(fake, REAL)
