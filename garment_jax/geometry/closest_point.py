"""Closest points and signed distances to a posed triangle mesh (section 3.5, `b`, `n`, `ds`).

The search is exact; the last frame's triangle only bounds what has to be looked at.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from garment_jax.geometry.stencil import materialised
from garment_jax.geometry.surface_search import (
    PosedSurface,
    coordinates_of,
    distance_to,
    distance_to_corner,
    nearest_leaf,
    pose_surface,
    search,
)
from garment_jax.geometry.surface_tables import SurfaceTables
from garment_jax.geometry.triangle import Coordinates, closest_on_triangle, cross, dot, minus, triangle_rows


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
    found = search(fixed.T[:, None], bound[None], still, tables)
    # nothing is found only for points that are not finite, and their answer is not either
    return closest_point_on(jnp.maximum(found.triangle[0], 0), local, surface, tables)


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
    groups, planes = jnp.asarray(groups).T, fixed.T
    found = search(planes[:, groups], distance_to(previous, planes, still, tables)[groups], still, tables)
    # Padding repeats a point, whose slots agree, so the order of the writes does not matter.
    triangle = previous.at[groups].set(jnp.where(found.triangle < 0, previous[groups], found.triangle))
    return closest_point_on(triangle, local, surface, tables)


def closest_point_on(
    triangle: Int[Array, " n"], local: Float[Array, "n 3"], surface: PosedSurface, tables: SurfaceTables
) -> ClosestPoint:
    """Return the signed closest points on the given triangles; differentiable, finite everywhere.

    `local` is relative to `surface.origin`; the answer's `point` is not.
    """
    found = signed_on(triangle, tuple(local.T), surface, tables)
    point, normal, direction = (
        jnp.stack(list(x), axis=-1) for x in (found.point, found.normal, found.direction)
    )
    return ClosestPoint(point + surface.origin[None], normal, found.ds, direction, triangle)


class Signed(NamedTuple):
    """As `ClosestPoint`, coordinate by coordinate (three arrays `[n]` each) and relative to the origin."""

    point: Coordinates
    normal: Coordinates
    ds: jax.Array  # [n]
    direction: Coordinates


def signed_on(
    triangle: Int[Array, " n"], p: Coordinates, surface: PosedSurface, tables: SurfaceTables
) -> Signed:
    """Return the signed closest points of `p`, relative to `surface.origin`, on the given triangles.

    Without a sum over axes: so it is a few operations and not forty.
    """
    a, b, c = materialised(_corners(triangle, surface, tables))
    ab, ac = minus(b, a), minus(c, a)
    s, u, squared, region = materialised(closest_on_triangle(p, triangle_rows(a, ab, ac)))
    foot = tuple(x + s * y + u * z for x, y, z in zip(a, ab, ac, strict=True))
    normal = _pseudo_normal(triangle, region, _unit(cross(ab, ac)), surface, tables)
    foot, normal = materialised((foot, normal))  # or they are made anew for each coordinate
    away = minus(p, foot)
    # Nearer than a micrometre the difference of the two points is rounding; the normal is not.
    touching = squared <= 1e-12
    height = dot(away, normal)
    sign = jnp.where(height < 0, -1.0, 1.0)
    distance = jnp.sqrt(jnp.where(touching, 1.0, squared))
    direction = tuple(jnp.where(touching, n, sign / distance * x) for n, x in zip(normal, away, strict=True))
    return Signed(foot, normal, jnp.where(touching, height, sign * distance), direction)


def _corners(triangle, surface: PosedSurface, tables: SurfaceTables) -> tuple[Coordinates, ...]:
    vertex = materialised(jnp.asarray(tables.faces)[triangle])
    corners = coordinates_of(vertex.T, surface.flat)
    return tuple(tuple(corners[x, k] for x in range(3)) for k in range(3))


def _pseudo_normal(triangle, region, own: Coordinates, surface, tables) -> Coordinates:
    """Return the outward normal of the feature that the closest point lies on (`own`: the triangle's).

    Face: its normal; edge: the mean of both sides; corner: the mean around it weighted by angle,
    which alone gives the right sign there (Baerentzen and Aanaes 2005).
    """
    faces, across = jnp.asarray(tables.faces), jnp.asarray(tables.across)
    a, b, c = _corners(materialised(across[triangle, jnp.clip(region - 1, 0, 2)]), surface, tables)
    beyond = _unit(cross(minus(b, a), minus(c, a)))
    edge = _unit(tuple(x + y for x, y in zip(own, beyond, strict=True)))
    vertex = materialised(faces[triangle, jnp.clip(region - 4, 0, 2)])
    corner = _fan_normal(vertex, materialised(jnp.asarray(tables.fan)[vertex]), surface.vertices)
    if len(tables.wide):
        wide = _fan_normal(jnp.asarray(tables.wide), jnp.asarray(tables.wide_fan), surface.vertices)
        place = jnp.asarray(tables.wide_place)[vertex]
        corner = tuple(jnp.where(place >= 0, w[place], x) for w, x in zip(wide, corner, strict=True))
    three = zip(own, edge, corner, strict=True)
    return tuple(jnp.where(region == 0, f, jnp.where(region <= 3, e, c)) for f, e, c in three)


def _fan_normal(vertex: Array, fan: Array, vertices: Array) -> Coordinates:
    """Return the angle-weighted normals of vertices `[n]` with the triangles `fan` `[n, k, 2]`.

    The weights are constants to a gradient: how a corner's angle changes is of no use to anyone.
    """
    ahead = vertices[fan] - vertices[vertex][:, None, None]
    ab, ac = (tuple(ahead[:, :, side, x] for x in range(3)) for side in range(2))
    normal = _unit(cross(ab, ac))
    fixed_ab, fixed_ac = jax.lax.stop_gradient((ab, ac))
    lengths = jnp.sqrt(dot(fixed_ab, fixed_ab) * dot(fixed_ac, fixed_ac))
    angle = _arccos(dot(fixed_ab, fixed_ac) / jnp.where(lengths > 0, lengths, 1.0))
    return _unit(tuple((angle * x).sum(axis=1) for x in normal))


def _unit(u: Coordinates) -> Coordinates:
    """Return `normals.unit` of separate coordinates."""
    squared = dot(u, u)
    long = squared > 1e-30
    length = jnp.sqrt(jnp.where(long, squared, 1.0))
    return tuple(jnp.where(long, x / length, 0.0) for x in u)


def _arccos(x: Array) -> Array:
    """Return arccos within 7e-5 rad (Abramowitz and Stegun 4.4.45), which vectorises; weights only."""
    y = jnp.minimum(jnp.abs(x), 1.0)
    near = jnp.sqrt(1 - y) * (1.5707288 + y * (-0.2121144 + y * (0.0742610 - 0.0187293 * y)))
    return jnp.where(x < 0, jnp.pi - near, near)
