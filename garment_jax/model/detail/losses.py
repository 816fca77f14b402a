"""Losses of the detail enhancement (paper 3.4), every weighted term by name.

L1 is the mean over vertices of |x| + |y| + |z| in cm. The paper's plain sum over the mesh is n times that;
as a mean it does not change its weight against the adversarial term with the mesh.

L1 alone flattens: where a fold lies cannot be known from the motion, and the least error is half a fold. So
`lambda_folds` (a departure) holds the folds' depth around each vertex to the truth's, wherever they lie.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.config import DetailConfig
from garment_jax.dataset.template import Template
from garment_jax.geometry.laplacian import laplacian

REAL, FAKE = 1.0, -1.0  # the discriminator's targets
BANDS = (1, 2, 4)  # smoothings between one band of folds and the next
NEAR = 8  # smoothings of their power: depth is compared over some rings, not fold by fold
FLAT = 1e-3  # cm, below any fold


def l1_cm(E: Float[Array, "*b n 3"]) -> Float[Array, "*b"]:
    """Return the mean over vertices of the 1-norm of `E` (metres), cm; its gradient is 0 at E = 0."""
    # jnp.abs has a gradient of 1 at 0
    return 100.0 * (E * jnp.sign(E)).sum(axis=-1).mean(axis=-1)


def fold_depth(V: Float[Array, "*b n 3"], *, template: Template) -> Float[Array, "*b n k"]:
    """Return how deep the folds around every vertex are, by wavelength from fine to broad, cm.

    The Laplacian of garments `V` (metres) in `BANDS` as `evaluation.cloth.band_power` takes them, its local
    root mean square over some rings. Interior vertices alone count.
    """
    keep = jnp.asarray(template.interior, V.dtype).reshape((1,) * (V.ndim - 2) + (-1, 1))

    def smooth(x: jax.Array, rounds: int) -> jax.Array:
        for _ in range(rounds):
            x = x + 0.5 * laplacian(x, template.laplacian)
        return x

    x, powers = keep * 100.0 * laplacian(V, template.laplacian), []
    for rounds in BANDS:
        y = smooth(x, rounds)
        powers.append(keep * jnp.square(x - y).sum(axis=-1, keepdims=True))
        x = y
    power = smooth(jnp.concatenate(powers, axis=-1), NEAR)
    return jnp.sqrt(power + FLAT**2)  # its gradient is finite where there are none


def detail_terms(
    V_f: Float[Array, "*b n 3"],
    V_star: Float[Array, "*b n 3"],
    *,
    template: Template,
    config: DetailConfig,
) -> dict[str, jax.Array]:
    """Return the weighted terms of L_geo for each frame (metres in, cm out)."""
    E = V_f - V_star
    terms = {
        "vertex": l1_cm(E),
        # the operator is linear: one Laplacian of the difference instead of two
        "laplacian": config.lambda_laplacian * l1_cm(laplacian(E, template.laplacian)),
    }
    if config.lambda_folds:
        missing = fold_depth(V_f, template=template) - fold_depth(V_star, template=template)
        terms["folds"] = config.lambda_folds * (missing * jnp.sign(missing)).mean(axis=(-2, -1))
    return terms


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
