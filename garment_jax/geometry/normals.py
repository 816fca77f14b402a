"""Unit normals of triangles and vertices, safe where a triangle has no area."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int


def unit(x: Float[Array, "... 3"], *, tiny: float = 1e-30) -> Float[Array, "... 3"]:
    """Return `x` at length 1, and the zero vector with a zero gradient where |x|^2 <= `tiny`.

    The inner `where` keeps the square root away from 0, whose derivative is infinite there and
    would turn the masked branch's gradient into NaN.
    """
    squared = (x * x).sum(axis=-1, keepdims=True)
    safe = jnp.where(squared > tiny, squared, 1.0)
    return jnp.where(squared > tiny, x / jnp.sqrt(safe), 0.0)


def face_normals(vertices: Float[Array, "n 3"], faces: Int[Array, "f 3"]) -> Float[Array, "f 3"]:
    """Return the unit normal of every triangle by the right-hand rule; zero where it has no area."""
    corners = jnp.take(vertices, faces, axis=0)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    # Edges at length 1, so that the test for "no area" is one on the angle (1e-6 rad) at any scale.
    return unit(jnp.cross(unit(first), unit(second)), tiny=1e-12)


def corner_angles(corners: Float[Array, "f 3 3"]) -> Float[Array, "f 3"]:
    """Return the angle (radians) at each corner of triangles `[f, corner, xyz]`; 0 at a collapsed edge."""
    following, preceding = jnp.roll(corners, -1, axis=1), jnp.roll(corners, 1, axis=1)
    u, v = unit(following - corners), unit(preceding - corners)
    cosine = (u * v).sum(axis=-1)
    # atan2 of both lengths, since arccos has an infinite slope at a needle's tip. Its own slope at
    # the origin (both lengths zero: a collapsed edge) is undefined, hence the replaced argument.
    squared = (jnp.cross(u, v) ** 2).sum(axis=-1)
    flat = squared <= 1e-14
    sine = jnp.where(flat, 0.0, jnp.sqrt(jnp.where(flat, 1.0, squared)))
    collapsed = ~u.any(axis=-1) | ~v.any(axis=-1)
    return jnp.where(collapsed, 0.0, jnp.arctan2(sine, jnp.where(collapsed, 1.0, cosine)))


def vertex_normals(vertices: Float[Array, "n 3"], faces: Int[Array, "f 3"]) -> Float[Array, "n 3"]:
    """Return unit vertex normals, each incident triangle weighted by its angle there.

    The angle weight makes the sign of a signed distance right at vertices (Baerentzen and Aanaes,
    "Signed distance computation using the angle weighted pseudonormal", 2005) and, unlike an area
    weight, does not depend on how a flat face is cut into triangles. A vertex without a triangle
    of positive area gets zero.
    """
    angles = corner_angles(jnp.take(vertices, faces, axis=0))
    weighted = face_normals(vertices, faces)[:, None] * angles[..., None]
    total = jnp.zeros_like(vertices).at[faces.reshape(-1)].add(weighted.reshape(-1, 3))
    return unit(total)
