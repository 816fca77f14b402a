"""Vertices to UV maps and back: one gather each way at run time (paper 3.2)."""

from jaxtyping import Array, Float

from garment_jax.geometry.stencil import apply_stencil
from garment_jax.geometry.uv_atlas import UvAtlas


def to_map(V: Float[Array, "*b n c"], atlas: UvAtlas) -> Float[Array, "*b h w c"]:
    """Return the UV map of per-vertex values `V`: the barycentric mix of each texel's triangle.

    Texels outside the charts repeat their nearest covered texel (dilation).
    """
    return apply_stencil(V, atlas.to_map).reshape(*V.shape[:-2], *atlas.coverage.shape, V.shape[-1])


def from_map(S: Float[Array, "*b h w c"], atlas: UvAtlas) -> Float[Array, "*b n c"]:
    """Return the values `[n, c]` that vertices read from `S` by bilinear sampling at their UVs.

    A vertex on a seam has several UVs: their mean.
    """
    return apply_stencil(S.reshape(*S.shape[:-3], -1, S.shape[-1]), atlas.from_map)
