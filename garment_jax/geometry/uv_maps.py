"""Vertices to UV maps and back: one gather each way at run time (paper 3.2)."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.geometry.uv_atlas import UvAtlas


def to_map(V: Float[Array, "n c"], atlas: UvAtlas) -> Float[Array, "h w c"]:
    """Return the UV map of per-vertex values `V`: the barycentric mix of each texel's triangle.

    Texels outside the charts repeat their nearest covered texel (dilation).
    """
    corners = jnp.take(V, atlas.texel_vertex, axis=0)
    return (corners * atlas.texel_weight[..., None]).sum(axis=-2)


def from_map(S: Float[Array, "h w c"], atlas: UvAtlas) -> Float[Array, "n c"]:
    """Return the values `[n, c]` that vertices read from `S` by bilinear sampling at their UVs.

    A vertex on a seam has several UVs: their mean.
    """
    flat = S.reshape(-1, S.shape[-1])
    at_uv = (jnp.take(flat, atlas.read_texel, axis=0) * atlas.read_weight[..., None]).sum(axis=1)
    at_vertex = jnp.take(at_uv, atlas.vertex_uv, axis=0)
    return (at_vertex * atlas.vertex_uv_weight[..., None]).sum(axis=1)
