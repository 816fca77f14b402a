"""The multi-scale patch discriminator D_ms behind pure functions (paper 3.4).

Four stride-2 convolutions on a garment's UV map; the outputs of the second to the fourth each carry a dense
layer that scores every texel, that is, a patch of the garment. The scores' maps have 64, 32 and 16 texels a
side at a UV map of 256 x 256, the paper's sizes; at 64 x 64 they have 16, 8 and 4.
"""

import flax.linen as nn
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.config import DetailConfig
from garment_jax.dataset.template import Template
from garment_jax.geometry.laplacian import laplacian
from garment_jax.geometry.uv_maps import to_map
from garment_jax.model.detail.network import mean_edge
from garment_jax.model.generative.blocks import DownConvolution, InstanceNorm, leaky
from garment_jax.model.generative.network import position_map

WRINKLE = 0.1  # of a mean edge: the Laplacian's size on simulated cloth (2 mm at edges of 24 mm)


class PatchDiscriminator(nn.Module):
    """D_ms: maps `[*b, h, w, c]` -> a score map `[*b, h/2^i, w/2^i]` for each convolution i > 1."""

    channels: tuple[int, ...]

    @nn.compact
    def __call__(self, S: jax.Array) -> tuple[jax.Array, ...]:
        x, scores = S, []
        for i, width in enumerate(self.channels):
            x = leaky(InstanceNorm()(DownConvolution(width)(x)))
            if i:
                scores.append(nn.Dense(1)(x)[..., 0])
        return tuple(scores)


def discriminator_map(
    V: Float[Array, "*b n 3"], *, template: Template, config: DetailConfig
) -> Float[Array, "*b h w c"]:
    """Return what D_ms sees of garments `V` (metres, root frame): their normalised position map.

    In it a wrinkle is 1/60 of the garment's shape, and no scale helps: instance norm takes it out again. So
    `config.wrinkle_map` adds the map of the Laplacian, in units of a tenth of the mean rest edge. A
    departure; without it the input is the paper's.
    """
    S = position_map(V, template)
    if not config.wrinkle_map:
        return S
    wrinkles = laplacian(V, template.laplacian) / (WRINKLE * mean_edge(template))
    return jnp.concatenate([S, to_map(wrinkles, template.atlas)], axis=-1)


def init_discriminator(key: jax.Array, template: Template, *, config: DetailConfig) -> dict:
    """Return fresh parameters of D_ms; the key is consumed.

    Raises `ValueError` where the last convolution leaves less than 2 x 2 texels: instance norm makes every
    single texel 0, and its score could tell nothing apart.
    """
    size, halvings = template.atlas.coverage.shape[0], len(config.channels)
    if halvings < 2 or size % 2**halvings or size < 2 ** (halvings + 1):
        raise ValueError(
            f"uv.size = {size} and {halvings} convolutions (detail.channels) leave D_ms no map of 2 x 2 "
            "texels or more to score; take 4 convolutions and a power of 2 from 32, or "
            "detail.lambda_adversarial = 0."
        )
    S = jnp.zeros((size, size, 6 if config.wrinkle_map else 3))
    # jitted: initialising operation by operation compiles hundreds of small programs
    return jax.jit(PatchDiscriminator(config.channels).init)(key, S)["params"]


def discriminate(
    params: dict, V: Float[Array, "*b n 3"], *, template: Template, config: DetailConfig
) -> tuple[jax.Array, ...]:
    """Return the scores of garments `V` (metres, root frame), one map a scale: +1 real, -1 fake."""
    S = discriminator_map(V, template=template, config=config)
    scores = PatchDiscriminator(config.channels).apply({"params": params}, S)
    return tuple(jnp.asarray(score) for score in scores)
