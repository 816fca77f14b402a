"""Closest points and signed distances to a posed triangle mesh (section 3.5, `b`, `n`, `ds`).

A query is exact where it matters: distance to a surface changes by at most 1 m per metre, so one
exact distance clears a whole group of points that lies farther out than the group is wide, and
the last frame's triangle bounds what has to be searched for the rest.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from garment_jax.geometry.normals import unit
from garment_jax.geometry.surface_search import (
    Budget,
    PosedSurface,
    pose_surface,
    rows_of,
    search_all,
    search_groups,
    stored,
)
from garment_jax.geometry.surface_tables import SurfaceTables
from garment_jax.geometry.triangle import closest_on_triangle


class ClosestPoint(NamedTuple):
    """The answer for `n` points, in the frame and unit of the query."""

    point: jax.Array  # [n, 3] closest point of the surface (b)
    normal: jax.Array  # [n, 3] unit outward pseudo-normal there (n)
    ds: jax.Array  # [n] signed distance, positive outside
    direction: jax.Array  # [n, 3] unit gradient of ds: (v - b) / ds, or the normal where v is at b
    triangle: jax.Array  # [n] int32 row of the tables' faces
    exact: jax.Array  # [n] bool: no triangle is nearer; if not, the point is outside by `reach`


def closest_point_exact(
    points: Float[Array, "n 3"], vertices: Float[Array, "c 3"], tables: SurfaceTables
) -> ClosestPoint:
    """Return the closest points by testing every triangle (first frame, reference, fallback)."""
    surface = pose_surface(vertices, tables)
    local = points - surface.origin[None]
    triangle = search_all(*jax.lax.stop_gradient((local, surface)))
    return _answer(local, triangle, jnp.ones(len(points), bool), surface, tables)


def closest_point_from(
    previous: Int[Array, " n"],
    points: Float[Array, "n 3"],
    vertices: Float[Array, "c 3"],
    tables: SurfaceTables,
    groups: Int[Array | np.ndarray, "g s"],
    *,
    reach: float | Array = 0.02,
    budget: Budget = Budget(),
) -> ClosestPoint:
    """Return the closest points `[n, 3]`, bounded by the distance to each point's `previous` triangle.

    Exact for every point with `ds` below `reach` (metres); the others are proved to be outside by
    at least `reach` and carry the closest point of a triangle near by, an upper bound. `groups`
    comes from `point_groups`. When the work lists overflow (a first frame, a jump), the answer
    comes from brute force, about a hundred times dearer. Points that are not finite have no answer.
    """
    surface = pose_surface(vertices, tables)
    return closest_point_posed(previous, points, surface, tables, groups, reach=reach, budget=budget)


def closest_point_posed(
    previous: Int[Array, " n"],
    points: Float[Array, "n 3"],
    surface: PosedSurface,
    tables: SurfaceTables,
    groups: Int[Array | np.ndarray, "g s"],
    *,
    reach: float | Array = 0.02,
    budget: Budget = Budget(),
) -> ClosestPoint:
    """As `closest_point_from`, on a surface that was posed once for several queries."""
    local = points - surface.origin[None]
    fixed, still = jax.lax.stop_gradient((local, surface))
    triangle, exact, fits = _search(previous, fixed, still, tables, jnp.asarray(groups), reach, budget)
    triangle = jax.lax.cond(fits, lambda: triangle, lambda: search_all(fixed, still))
    return _outside(_answer(local, triangle, exact | ~fits, surface, tables))


def closest_point_groups(
    previous: Int[Array, "g s"],
    points: Float[Array, "g s 3"],
    limit: Float[Array, "g s"],
    surface: PosedSurface,
    tables: SurfaceTables,
    *,
    budget: Budget = Budget(),
) -> ClosestPoint:
    """Return the closest points, fields `[g * s, ...]`, of a few groups of points that lie together.

    Exact within `limit` (metres; infinite for a point that may be inside). A point with nothing
    that near must be known to be outside, and keeps its `previous` triangle. Brute force, again,
    when the work lists overflow.
    """
    local = points - surface.origin[None, None]
    fixed, still = jax.lax.stop_gradient((local, surface))
    flat = fixed.reshape(-1, 3)
    start = rows_of(jnp.asarray(tables.faces)[previous.reshape(-1)], still.vertices)
    bound = jnp.sqrt(closest_on_triangle(tuple(flat.T), start)[2]).reshape(previous.shape)
    bound = jnp.minimum(_grown(bound), limit)
    found = search_groups(fixed, bound, jnp.ones(len(points), bool), still, budget)
    triangle = jnp.where(found.triangle < 0, previous, found.triangle).reshape(-1)
    triangle = jax.lax.cond(found.fits, lambda: triangle, lambda: search_all(flat, still))
    exact = (found.triangle >= 0).reshape(-1) | ~found.fits
    return _outside(_answer(local.reshape(-1, 3), triangle, exact, surface, tables))


def _outside(answer: ClosestPoint) -> ClosestPoint:
    """Return the answer with cleared points outside: their triangle may be seen from behind."""
    return answer._replace(ds=jnp.where(answer.exact, answer.ds, jnp.abs(answer.ds)))


def _search(previous, local, surface, tables, groups, reach, budget):
    """Return `(triangle [n], exact [n], fits [])`: first one point of each group, then near groups."""
    start = rows_of(jnp.asarray(tables.faces)[previous], surface.vertices)
    bound = stored(jnp.sqrt(closest_on_triangle(tuple(local.T), start)[2]))
    p = local[groups]  # [g, s, 3]
    first = groups[:, :1]
    # Nothing inside is deeper than the body is thick; half as much again for the pose's bulging.
    enough = jnp.minimum(_grown(bound[first]), 1.5 * tables.thickness + reach)
    lead = search_groups(p[:, :1], enough, jnp.ones(len(groups), bool), surface, budget.single())
    lead_triangle = jnp.where(lead.triangle < 0, previous[first], lead.triangle)
    sign = jnp.sign(_answer(p[:, 0], lead_triangle[:, 0], None, surface, tables).ds)[:, None]
    lead_ds = jnp.where(lead.triangle < 0, lead.distance, sign * lead.distance)
    spread = jnp.sqrt(((p - p[:, :1]) ** 2).sum(axis=-1))  # [g, s]
    near = (lead_ds - spread < reach).any(axis=1)
    # A point that is inside is at most `spread - lead_ds` deep: nothing found that near, it is outside.
    limit = jnp.minimum(_grown(bound[groups]), jnp.maximum(reach, _grown(spread - lead_ds)))
    rest = search_groups(p, limit, near, surface, budget)
    found = jnp.where(rest.triangle < 0, lead_triangle, rest.triangle)
    # Padding repeats a point, whose slots agree, so the order of the writes does not matter.
    triangle = previous.at[groups].set(found)
    exact = jnp.zeros(len(local), bool).at[groups].set(near[:, None] & (rest.triangle >= 0))
    return triangle, exact, lead.fits & rest.fits


def _grown(bound: Array) -> Array:
    """Return a bound larger by more than rounding, so that the triangle that gave it passes."""
    return bound * (1 + 1e-4) + 1e-6


def _answer(local, triangle, exact, surface, tables) -> ClosestPoint:
    """Return the signed closest points on the given triangles; differentiable, finite everywhere."""
    corners = jnp.asarray(tables.faces)[triangle]
    foot = closest_on_triangle(tuple(local.T), rows_of(corners, surface.vertices))
    s, u, squared, region = stored(foot)
    a, b, c = (surface.vertices[corners[:, k]] for k in range(3))
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
    return ClosestPoint(b + surface.origin[None], normal, ds, direction, triangle, exact)


def _pseudo_normal(triangle, region, surface, tables):
    """Return the outward normal `[n, 3]` of the feature that the closest point lies on.

    Face: its normal; edge: the mean of both sides; corner: the mean around it weighted by angle,
    which alone gives the right sign there (Baerentzen and Aanaes 2005).
    """
    faces, across = jnp.asarray(tables.faces), jnp.asarray(tables.across)
    normals, weighted = _corner_normals(surface, tables)
    own = normals[triangle]
    edge = unit(own + normals[across[triangle, jnp.clip(region - 1, 0, 2)]])
    vertex = faces[triangle, jnp.clip(region - 4, 0, 2)]
    surplus = jnp.zeros_like(surface.vertices)
    surplus = surplus.at[tables.surplus_vertex].add(weighted[jnp.asarray(tables.surplus_corner)])
    corner = unit(weighted[jnp.asarray(tables.incident)[vertex]].sum(axis=1) + surplus[vertex])
    return jnp.where((region == 0)[:, None], own, jnp.where((region <= 3)[:, None], edge, corner))


def _corner_normals(surface: PosedSurface, tables: SurfaceTables) -> tuple[Array, Array]:
    """Return unit face normals `[r, 3]` and, by corner, angle-weighted ones `[3 r + 1, 3]`, last zero.

    The weights are constants to a gradient: how a corner's angle changes is of no use to anyone.
    """
    rows = [x.reshape(-1) for x in surface.rows]
    a, b, c = (surface.vertices[jnp.asarray(tables.faces)[:, k]] for k in range(3))
    flat = (rows[21] < 0)[:, None]
    normals = jnp.where(flat, 0.0, unit(jnp.where(flat, 1.0, jnp.cross(b - a, c - a))))
    ab2, _, abac, inv_ab, inv_ac, inv_bc = jax.lax.stop_gradient(rows[15:21])
    first = _arccos(abac * jnp.sqrt(inv_ab * inv_ac))
    second = _arccos((ab2 - abac) * jnp.sqrt(inv_ab * inv_bc))
    angles = jnp.stack([first, second, jnp.maximum(jnp.pi - first - second, 0.0)], axis=1)
    weighted = (normals[:, None] * angles[..., None]).reshape(-1, 3)
    return normals, jnp.concatenate([weighted, jnp.zeros((1, 3), weighted.dtype)])


def _arccos(x: Array) -> Array:
    """Return arccos within 7e-5 rad (Abramowitz and Stegun 4.4.45), which vectorises; weights only."""
    y = jnp.minimum(jnp.abs(x), 1.0)
    near = jnp.sqrt(1 - y) * (1.5707288 + y * (-0.2121144 + y * (0.0742610 - 0.0187293 * y)))
    return jnp.where(x < 0, jnp.pi - near, near)
