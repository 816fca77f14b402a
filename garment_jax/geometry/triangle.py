"""The closest point of a triangle, on separate coordinate arrays so that it vectorises.

A triangle without area is the longest of its edges, one without length its first corner.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Coordinates = tuple[Array, ...]  # x, y, z, each of the same shape
Vector = Coordinates | list[Array] | Array | np.ndarray  # x, y, z first


FLAT = 1e-12  # squared sine of the angle below which a triangle has no inside
THIN = 1e-5  # the same, below which its normal is no guide: a neighbour that is as near is preferred


def dot(u: Vector, v: Vector):
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def squared_length(u: Vector):
    return dot(u, u)


def least(x: Array, y: Array | float) -> Array:
    """Return the lesser, `y` where one is not a number: an instruction, where `jnp.minimum` takes three."""
    return jnp.where(x < y, x, y)


def most(x: Array, y: Array | float) -> Array:
    """Return the greater, `y` where one is not a number."""
    return jnp.where(x > y, x, y)


def cross(u: Vector, v: Vector):
    return (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])


def _inverse(x: Array) -> Array:
    """Return 1 / x, and 0 (with a zero gradient) where x is 0: a collapsed edge is its first point."""
    return jnp.where(x > 0, 1.0 / jnp.where(x > 0, x, 1.0), 0.0)


def triangle_inverses(ab: Vector, ac: Vector) -> tuple[Array, Array, Array, Array]:
    """Return 1 over the squares of twice the area and of the edges `ab`, `ac`, `bc`; 0 where there is none.

    A triangle thinner than 1e-6 of its edges counts as without area.
    """
    ab2, ac2 = dot(ab, ab), dot(ac, ac)
    bc2 = jnp.maximum(ab2 - 2 * dot(ab, ac) + ac2, 0.0)
    n2 = squared_length(cross(ab, ac))
    flat = n2 <= FLAT * ab2 * ac2
    area = jnp.where(flat, 0.0, 1.0 / jnp.where(flat, 1.0, n2))
    return area, _inverse(ab2), _inverse(ac2), _inverse(bc2)


def triangle_rows(
    a: Vector, ab: Vector, ac: Vector, inverses: tuple[Array, Array, Array, Array]
) -> list[Array]:
    """Return what a test of a triangle needs: corner, edges, dual edges, products (22 arrays).

    `x . g` are the barycentric coordinates of x's foot point. A triangle without area (`triangle_inverses`)
    has none and is tested by its edges alone.
    """
    area, *edges = inverses
    n = cross(ab, ac)
    g = [x * area for x in (*cross(ac, n), *cross(n, ab))]
    return [*a, *ab, *ac, *g, dot(ab, ab), dot(ac, ac), dot(ab, ac), *edges, jnp.where(area > 0, 0.0, -1.0)]


def closest_on_triangle(p: Vector, rows: list[Array]) -> tuple[Array, Array, Array, Array]:
    """Return `(s, u, squared distance, region)` of the closest points a + s ab + u ac to `p`.

    Region: 0 face; 1, 2, 3 edges (0,1), (1,2), (2,0); 4, 5, 6 corners 0, 1, 2.
    """
    a, ab, ac, gb, gc = (rows[3 * k : 3 * k + 3] for k in range(5))
    ab2, ac2, abac, inv_ab, inv_ac, inv_bc, offset = rows[15:]
    ap = tuple(x - y for x, y in zip(p, a, strict=True))
    d1, d2 = dot(ab, ap), dot(ac, ap)
    s, u = dot(gb, ap) + offset, dot(gc, ap)
    inside = (s >= 0) & (u >= 0) & (s + u <= 1)
    e1, e3 = jnp.clip(d1 * inv_ab, 0.0, 1.0), jnp.clip(d2 * inv_ac, 0.0, 1.0)
    e2 = jnp.clip(((d2 - d1) - (abac - ab2)) * inv_bc, 0.0, 1.0)
    f1, f3 = e1 * (e1 * ab2 - 2 * d1), e3 * (e3 * ac2 - 2 * d2)
    t = 1 - e2
    f2 = t * (t * ab2 - 2 * d1) + e2 * (e2 * ac2 - 2 * d2) + 2 * t * e2 * abac
    first, third = (f1 <= f2) & (f1 <= f3), f3 < f2
    edge_s = jnp.where(first, e1, jnp.where(third, 0.0, t))
    edge_u = jnp.where(first, 0.0, jnp.where(third, e3, e2))
    s, u = jnp.where(inside, s, edge_s), jnp.where(inside, u, edge_u)
    r = [x - s * y - u * z for x, y, z in zip(ap, ab, ac, strict=True)]
    return s, u, dot(r, r), jnp.where(inside, 0, _region(s, u, first, third))


def _region(s: Array, u: Array, first: Array, third: Array) -> Array:
    edge = jnp.where(first, 1, jnp.where(third, 3, 2))
    corner = jnp.where(s >= 1, 5, jnp.where(u >= 1, 6, 4))
    return jnp.where((s >= 1) | (u >= 1) | ((s <= 0) & (u <= 0)), corner, edge)


def squared_distance(points: Float[Array, "3 k"], corners: Float[Array, "3 3 k t"]) -> Float[Array, "k t"]:
    """Return the squared distances of points to `t` triangles each: to the plane, or to the edges.

    Coordinates come first, then the corners' numbers, so that the arithmetic vectorises over triangles.

    Half the work of `closest_on_triangle`, for a search that only compares. Needles and triangles
    without area, whose sides cannot be told, come out a hundred-thousandth farther.
    """
    p = tuple(points[x, :, None] for x in range(3))
    a, b, c = (tuple(corners[x, j] for x in range(3)) for j in range(3))
    ab, ac, bc, pa, pb = minus(b, a), minus(c, a), minus(c, b), minus(p, a), minus(p, b)
    n = cross(ab, ac)
    n2 = dot(n, n)
    m = cross(pa, n)
    toward_c, toward_b = dot(ab, m), -dot(ac, m)  # n2 times the foot point's barycentric coordinates
    inside = (toward_b >= 0) & (toward_c >= 0) & (toward_b + toward_c <= n2)
    sine = n2 * _inverse(dot(ab, ab) * dot(ac, ac))
    height = dot(n, pa)
    edge = least(least(_to_edge(pa, ab), _to_edge(pa, ac)), _to_edge(pb, bc))
    squared = jnp.where(inside & (sine > FLAT), height * height / jnp.where(n2 > 0, n2, 1.0), edge)
    return jnp.where(sine > THIN, squared, squared * (1 + 2e-5) + 1e-12)


def _to_edge(p: Vector, e: Vector):
    """Return the squared distance to the segment from 0 to `e`; to 0 if it has no length."""
    t = least(most(dot(p, e) * _inverse(dot(e, e)), 0.0), 1.0)
    r = tuple(x - t * y for x, y in zip(p, e, strict=True))
    return dot(r, r)


def minus(u: Vector, v: Vector):
    return tuple(x - y for x, y in zip(u, v, strict=True))
