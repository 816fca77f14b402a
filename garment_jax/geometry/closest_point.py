"""Closest points and signed distances to a posed triangle mesh (section 3.5, `b`, `n`, `ds`).

The search is exact; the last frame's triangle only bounds what has to be looked at.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from garment_jax.geometry.normals import unit
from garment_jax.geometry.surface_search import (
    PosedSurface,
    distance_to,
    distance_to_corner,
    nearest_leaf,
    pose_surface,
    search,
    triangles,
)
from garment_jax.geometry.surface_tables import SurfaceTables
from garment_jax.geometry.triangle import closest_on_triangle, triangle_rows


class ClosestPoint(NamedTuple):
    """The answer for `n` points, in the frame and unit of the query."""

    point: jax.Array  # [n, 3] closest point of the surface (b)
    normal: jax.Array  # [n, 3] unit outward pseudo-normal there (n)
    ds: jax.Array  # [n] signed distance, positive outside
    direction: jax.Array  # [n, 3] unit gradient of ds: (v - b) / ds, or the normal where v is at b
    triangle: jax.Array  # [n] int32 row of the tables' faces


def closest_point_exact(
    points: Float[Array, "n 3"], vertices: Float[Array, "c 3"], tables: SurfaceTables
) -> ClosestPoint:
    """Return the closest points of points in any order, with no knowledge of where they were."""
    surface = pose_surface(vertices, tables)
    local = points - surface.origin[None]
    fixed, still = jax.lax.stop_gradient((local, surface))
    bound = distance_to_corner(nearest_leaf(fixed, still, tables), fixed, still, tables)
    found = search(fixed[:, None], bound[:, None], still, tables)
    # nothing is found only for points that are not finite, and their answer is not either
    return closest_point_on(jnp.maximum(found.triangle[:, 0], 0), local, surface, tables)


def closest_point_from(
    previous: Int[Array, " n"],
    points: Float[Array, "n 3"],
    vertices: Float[Array, "c 3"],
    tables: SurfaceTables,
    groups: Int[Array | np.ndarray, "g s"],
) -> ClosestPoint:
    """Return the closest points `[n, 3]`, bounded by the distance to each point's `previous` triangle.

    The same answer as `closest_point_exact`, the faster the nearer the last frame's triangle still is.
    `groups` comes from `point_groups`.
    """
    surface = pose_surface(vertices, tables)
    local = points - surface.origin[None]
    fixed, still = jax.lax.stop_gradient((local, surface))
    groups = jnp.asarray(groups)
    found = search(fixed[groups], distance_to(previous, fixed, still, tables)[groups], still, tables)
    # Padding repeats a point, whose slots agree, so the order of the writes does not matter.
    triangle = previous.at[groups].set(jnp.where(found.triangle < 0, previous[groups], found.triangle))
    return closest_point_on(triangle, local, surface, tables)


def closest_point_on(
    triangle: Int[Array, " n"], local: Float[Array, "n 3"], surface: PosedSurface, tables: SurfaceTables
) -> ClosestPoint:
    """Return the signed closest points on the given triangles; differentiable, finite everywhere.

    `local` is relative to `surface.origin`; the answer's `point` is not.
    """
    corners = triangles(triangle, surface, tables)
    a, b, c = (corners[:, k] for k in range(3))
    rows = triangle_rows(*(tuple(x.T) for x in (a, b - a, c - a)))
    s, u, squared, region = closest_on_triangle(tuple(local.T), rows)
    b = a + s[:, None] * (b - a) + u[:, None] * (c - a)
    normal = _pseudo_normal(triangle, region, surface, tables)
    away = local - b
    # Nearer than a micrometre the difference of the two points is rounding; the normal is not.
    touching = squared <= 1e-12
    height = (away * normal).sum(axis=-1)
    sign = jnp.where(height < 0, -1.0, 1.0)
    distance = jnp.sqrt(jnp.where(touching, 1.0, squared))
    direction = jnp.where(touching[:, None], normal, (sign / distance)[:, None] * away)
    ds = jnp.where(touching, height, sign * distance)
    return ClosestPoint(b + surface.origin[None], normal, ds, direction, triangle)


def _pseudo_normal(triangle, region, surface, tables):
    """Return the outward normal `[n, 3]` of the feature that the closest point lies on.

    Face: its normal; edge: the mean of both sides; corner: the mean around it weighted by angle,
    which alone gives the right sign there (Baerentzen and Aanaes 2005).
    """
    faces, across = jnp.asarray(tables.faces), jnp.asarray(tables.across)
    own = _face_normal(faces[triangle], surface.vertices)
    edge = across[triangle, jnp.clip(region - 1, 0, 2)]
    edge = unit(own + _face_normal(faces[edge], surface.vertices))
    vertex = faces[triangle, jnp.clip(region - 4, 0, 2)]
    corner = _fan_normal(vertex, jnp.asarray(tables.fan)[vertex], surface.vertices)
    if len(tables.wide):
        wide = _fan_normal(jnp.asarray(tables.wide), jnp.asarray(tables.wide_fan), surface.vertices)
        place = jnp.asarray(tables.wide_place)[vertex]
        corner = jnp.where((place >= 0)[:, None], wide[place], corner)
    return jnp.where((region == 0)[:, None], own, jnp.where((region <= 3)[:, None], edge, corner))


def _face_normal(corners: Array, vertices: Array) -> Array:
    """Return unit normals `[n, 3]`; zero for a triangle without area."""
    a, b, c = (vertices[corners[:, k]] for k in range(3))
    return unit(jnp.cross(b - a, c - a))


def _fan_normal(vertex: Array, fan: Array, vertices: Array) -> Array:
    """Return the angle-weighted normals `[n, 3]` of vertices `[n]` with the triangles `fan` `[n, k, 2]`.

    The weights are constants to a gradient: how a corner's angle changes is of no use to anyone.
    """
    ahead = vertices[fan] - vertices[vertex][:, None, None]
    ab, ac = ahead[:, :, 0], ahead[:, :, 1]
    normal = unit(jnp.cross(ab, ac))
    fixed = jax.lax.stop_gradient(ahead)
    lengths = jnp.sqrt((fixed * fixed).sum(axis=-1)).prod(axis=-1)
    cosine = (fixed[:, :, 0] * fixed[:, :, 1]).sum(axis=-1) / jnp.where(lengths > 0, lengths, 1.0)
    return unit((_arccos(cosine)[..., None] * normal).sum(axis=1))


def _arccos(x: Array) -> Array:
    """Return arccos within 7e-5 rad (Abramowitz and Stegun 4.4.45), which vectorises; weights only."""
    y = jnp.minimum(jnp.abs(x), 1.0)
    near = jnp.sqrt(1 - y) * (1.5707288 + y * (-0.2121144 + y * (0.0742610 - 0.0187293 * y)))
    return jnp.where(x < 0, jnp.pi - near, near)
