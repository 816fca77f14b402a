"""Closest points and signed distances to a posed triangle mesh (section 3.5, `b`, `n`, `ds`).

The search is exact; the last frame's triangle only bounds what has to be looked at.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from garment_jax.geometry.gather import coordinates_of
from garment_jax.geometry.noinline import fusion_barrier, noinline
from garment_jax.geometry.surface_search import (
    PosedSurface,
    distance_to,
    distance_to_corner,
    nearest_leaf,
    pose_surface,
    search,
)
from garment_jax.geometry.surface_tables import SurfaceTables
from garment_jax.geometry.triangle import closest_on_triangle, cross, dot, triangle_inverses, triangle_rows


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
    found = search(fixed.T[:, None], bound[None], still)
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
    found = search(planes[:, groups], distance_to(previous, planes, still, tables)[groups], still)
    # Padding repeats a point, whose slots agree, so the order of the writes does not matter.
    triangle = previous.at[groups].set(jnp.where(found.triangle < 0, previous[groups], found.triangle))
    return closest_point_on(triangle, local, surface, tables)


def closest_point_on(
    triangle: Int[Array, " n"], local: Float[Array, "n 3"], surface: PosedSurface, tables: SurfaceTables
) -> ClosestPoint:
    """Return the signed closest points on the given triangles; differentiable, finite everywhere.

    `local` is relative to `surface.origin`; the answer's `point` is not.
    """
    found = signed_on(triangle, local.T, surface, tables)
    point = found.point.T + surface.origin[None]
    return ClosestPoint(point, found.normal.T, found.ds, found.direction.T, triangle)


class Signed(NamedTuple):
    """As `ClosestPoint`, with the coordinates first and relative to the origin."""

    point: jax.Array  # [3, n]
    normal: jax.Array  # [3, n]
    ds: jax.Array  # [n]
    direction: jax.Array  # [3, n]


@noinline
def signed_on(
    triangle: Int[Array, " n"], p: Float[Array, "3 n"], surface: PosedSurface, tables: SurfaceTables
) -> Signed:
    """Return the signed closest points of `p`, relative to `surface.origin`, on the given triangles."""
    corners = _corners(triangle, surface.flat, tables)
    a, ab, ac = _sides(corners)
    s, u, squared, region = _foot_in(p, a, ab, ac, _inverses(ab, ac))
    point, own = _foot(a, ab, ac, s, u)
    normal = _pseudo_normal(triangle, region, own, surface, tables)
    return Signed(point, normal, *_signed(p, point, normal, squared))


@noinline
def _corners(triangle: Int[Array, " n"], flat: Float[Array, " c3"], tables: SurfaceTables) -> Array:
    """Return the corners of triangles, `[3, 3, n]`: coordinate, corner, triangle."""
    vertex = fusion_barrier(jnp.asarray(tables.faces)[triangle])
    return coordinates_of(vertex.T, flat)


@noinline
def _sides(corners: Float[Array, "3 3 n"]) -> tuple[Array, Array, Array]:
    """Return the first corners and the two sides that begin there, `[3, n]` each."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    return a, b - a, c - a


@noinline
def _inverses(ab: Float[Array, "3 n"], ac: Float[Array, "3 n"]) -> tuple[Array, Array, Array, Array]:
    return triangle_inverses(ab, ac)


@noinline
def _foot_in(
    p: Float[Array, "3 n"],
    a: Float[Array, "3 n"],
    ab: Float[Array, "3 n"],
    ac: Float[Array, "3 n"],
    inverses: tuple[Array, Array, Array, Array],
) -> tuple[Array, Array, Array, Array]:
    """Return where in its triangle each closest point is, as `closest_on_triangle`."""
    return closest_on_triangle(p, triangle_rows(a, ab, ac, inverses))


@noinline
def _foot(
    a: Float[Array, "3 n"], ab: Float[Array, "3 n"], ac: Float[Array, "3 n"], s: Array, u: Array
) -> tuple[Array, Array]:
    """Return the closest points and the triangles' normals, `[3, n]` each."""
    return a + s[None] * ab + u[None] * ac, _unit(jnp.stack(cross(ab, ac)))


@noinline
def _signed(
    p: Float[Array, "3 n"],
    point: Float[Array, "3 n"],
    normal: Float[Array, "3 n"],
    squared: Float[Array, " n"],
) -> tuple[Array, Array]:
    """Return the signed distances and their gradients."""
    away = p - point
    # Nearer than a micrometre the difference of the two points is rounding; the normal is not.
    touching = squared <= 1e-12
    height = dot(away, normal)
    sign = jnp.where(height < 0, -1.0, 1.0)
    distance = jnp.sqrt(jnp.where(touching, 1.0, squared))
    direction = jnp.where(touching[None], normal, (sign / distance)[None] * away)
    return jnp.where(touching, height, sign * distance), direction


@noinline
def _pseudo_normal(
    triangle: Int[Array, " n"],
    region: Int[Array, " n"],
    own: Float[Array, "3 n"],
    surface: PosedSurface,
    tables: SurfaceTables,
) -> Float[Array, "3 n"]:
    """Return the outward normal of the feature that the closest point lies on (`own`: the triangle's).

    Face: its normal; edge: the mean of both sides; corner: the mean around it weighted by angle,
    which alone gives the right sign there (Baerentzen and Aanaes 2005).
    """
    beyond, vertex = _around(triangle, region, tables)
    edge = _edge_normal(own, _corners(beyond, surface.flat, tables))
    corner = _fan_normal(vertex, _fan_of(vertex, tables), surface.flat)
    if len(tables.wide):
        corner = _wide_too(corner, jnp.asarray(tables.wide_place)[vertex], surface.flat, tables)
    return jnp.where((region == 0)[None], own, jnp.where((region <= 3)[None], edge, corner))


@noinline
def _wide_too(
    corner: Float[Array, "3 n"], place: Int[Array, " n"], flat: Float[Array, " c3"], tables: SurfaceTables
) -> Float[Array, "3 n"]:
    """Return the normals of corners, those with a `place` among the widest made of all their triangles."""

    def some() -> Array:
        wide = _fan_normal(jnp.asarray(tables.wide), tables.wide_fan.transpose(2, 1, 0), flat)
        return jnp.where((place >= 0)[None], wide[:, place], corner)

    return jax.lax.cond((place >= 0).any(), some, lambda: corner)


@noinline
def _around(
    triangle: Int[Array, " n"], region: Int[Array, " n"], tables: SurfaceTables
) -> tuple[Array, Array]:
    """Return the triangle beyond the edge, and the vertex, that each closest point may lie on."""
    faces, across = jnp.asarray(tables.faces), jnp.asarray(tables.across)
    return across[triangle, jnp.clip(region - 1, 0, 2)], faces[triangle, jnp.clip(region - 4, 0, 2)]


@noinline
def _edge_normal(own: Float[Array, "3 n"], beyond: Float[Array, "3 3 n"]) -> Float[Array, "3 n"]:
    _, ab, ac = _sides(beyond)
    return _unit(own + _unit(jnp.stack(cross(ab, ac))))


@noinline
def _fan_of(vertex: Int[Array, " n"], tables: SurfaceTables) -> Int[Array, "2 k n"]:
    return fusion_barrier(jnp.asarray(tables.fan)[vertex].transpose(2, 1, 0))


@noinline
def _fan_normal(
    vertex: Int[Array, " n"], fan: Int[Array | np.ndarray, "2 k n"], flat: Float[Array, " c3"]
) -> Float[Array, "3 n"]:
    """Return the angle-weighted normals of vertices with the triangles `fan` around them.

    The weights are constants to a gradient: how a corner's angle changes is of no use to anyone.
    """
    at, around = coordinates_of(vertex, flat), coordinates_of(fan, flat)
    return _unit(_weighted(at, around).sum(axis=1))


@noinline
def _weighted(at: Float[Array, "3 n"], around: Float[Array, "3 2 k n"]) -> Float[Array, "3 k n"]:
    """Return the normals of triangles around vertices, each as long as its angle there."""
    ab, ac = (around[:, side] - at[:, None] for side in range(2))
    fixed_ab, fixed_ac = jax.lax.stop_gradient((ab, ac))
    lengths = jnp.sqrt(dot(fixed_ab, fixed_ab) * dot(fixed_ac, fixed_ac))
    angle = _arccos(dot(fixed_ab, fixed_ac) / jnp.where(lengths > 0, lengths, 1.0))
    return angle[None] * _unit(jnp.stack(cross(ab, ac)))


def _unit(u: Float[Array, "3 *k n"]) -> Float[Array, "3 *k n"]:
    """Return `normals.unit` of vectors with the coordinates first."""
    squared = dot(u, u)
    long = squared > 1e-30
    length = jnp.sqrt(jnp.where(long, squared, 1.0))
    return jnp.where(long[None], u / length[None], 0.0)


def _arccos(x: Array) -> Array:
    """Return arccos within 7e-5 rad (Abramowitz and Stegun 4.4.45), which vectorises; weights only."""
    y = jnp.minimum(jnp.abs(x), 1.0)
    near = jnp.sqrt(1 - y) * (1.5707288 + y * (-0.2121144 + y * (0.0742610 - 0.0187293 * y)))
    return jnp.where(x < 0, jnp.pi - near, near)
