"""Which way to move a garment so that the lines along which it goes through itself grow shorter.

Where an edge goes through a face such a line (a contour) runs on into the edge's own faces. Moved against the
face, the edge draws it in (Volino and Magnenat-Thalmann, Resolving Surface Collisions through Intersection
Contour Minimization, SIGGRAPH 2006). No layer needs to know which side of the other it belongs on.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from garment_jax.geometry.gather import coordinates_of
from garment_jax.geometry.noinline import noinline
from garment_jax.geometry.self_crossings import (
    AT_ONCE,
    CrossingTables,
    Found,
    blocked_mask,
    crosses,
    next_true,
)
from garment_jax.geometry.triangle import cross, dot, minus

STEEP = 1e-3  # cosine between edge and normal below which an edge counts as that steep

Vector = tuple[Array, ...]  # x, y, z of one or many points


class ContourTables(NamedTuple):
    """What does not change from frame to frame (static)."""

    ends: np.ndarray  # [2, a] int32 of all edges
    beside: np.ndarray  # [2, a] int32 third corners of an edge's faces; one of its ends where there is none
    faces: np.ndarray  # [3, k * g] int32 the groups' faces
    own: np.ndarray  # [k * g] bool: not the repetition of another


def make_contour_tables(faces: Int[np.ndarray, "f 3"], crossings: CrossingTables) -> ContourTables:
    """Return the tables of a mesh with at least one face."""
    ends = np.asarray(crossings.ends, np.int32)
    number = {tuple(edge): k for k, edge in enumerate(ends.tolist())}
    beside = np.repeat(ends[:, :1], 2, axis=1)
    met = np.zeros(len(ends), int)
    for face in np.asarray(faces, np.int32):
        for k in range(3):
            edge = number[tuple(sorted((int(face[k]), int(face[(k + 1) % 3]))))]
            if met[edge] < 2:
                beside[edge, met[edge]] = face[(k + 2) % 3]
            met[edge] += 1
    groups = crossings.faces
    own = np.ones(groups.shape[1:], bool)
    own[1:] = (groups[:, 1:] != groups[:, :-1]).any(axis=0)
    flat = np.ascontiguousarray(groups.reshape(3, -1))
    return ContourTables(np.ascontiguousarray(ends.T), np.ascontiguousarray(beside.T), flat, own.ravel())


def shorter_contours(
    V: Float[Array, "n 3"], found: Found, tables: ContourTables
) -> tuple[Float[Array, "n 3"], Float[Array, " n"]]:
    """Return the sum of directions in which what crosses in `V` (metres) pushes each vertex, and how many.

    A direction is shorter than 1. An edge's ends share one, a face's corners another, by where on them the
    crossing is.
    """
    edges, faces = blocked_mask(found.edge), blocked_mask(found.face & jnp.asarray(tables.own))
    flat = (V - V.mean(axis=0, keepdims=True)).T.reshape(-1)
    columns = -(-faces.count[-1] // AT_ONCE)

    def turn(carry: tuple[Array, Array]) -> tuple[Array, Array]:
        k, push = carry
        one, there = next_true(edges, AT_ONCE * (k // columns))
        other, here = next_true(faces, AT_ONCE * (k % columns))
        crossing = _through(flat, one, other, tables) & there[:, None] & here[None]
        return k + 1, _with_pairs(push, flat, crossing, (one, other), tables)

    turns = -(-edges.count[-1] // AT_ONCE) * columns
    _, push = jax.lax.while_loop(lambda c: c[0] < turns, turn, (jnp.int32(0), jnp.zeros((len(V), 4))))
    return push[:, :3], push[:, 3]


@noinline
def _through(flat: Array, one: Array, other: Array, tables: ContourTables) -> Array:
    ends, corners = (jnp.asarray(x)[:, k, None] for x, k in ((tables.ends, one), (tables.faces, other)))
    return crosses(ends, corners, coordinates_of(ends, flat), coordinates_of(corners, flat))[..., 0]


def _with_pairs(
    push: Array, flat: Array, crossing: Array, among: tuple[Array, Array], tables: ContourTables
) -> Array:
    pairs, width = blocked_mask(crossing.reshape(-1)), crossing.shape[1]

    def turn(carry: tuple[Array, Array]) -> tuple[Array, Array]:
        at, push = carry
        place, there = next_true(pairs, at)
        edge, face = among[0][place // width], among[1][place % width]
        ends, beside = (jnp.asarray(x)[:, edge] for x in (tables.ends, tables.beside))
        return at + AT_ONCE, _pushed(push, flat, ends, beside, jnp.asarray(tables.faces)[:, face], there)

    return jax.lax.while_loop(lambda c: c[0] < pairs.count[-1], turn, (jnp.int32(0), push))[1]


@noinline
def _pushed(
    push: Float[Array, "n 4"],
    flat: Float[Array, " m"],
    ends: Int[Array, "2 q"],
    beside: Int[Array, "2 q"],
    corners: Int[Array, "3 q"],
    there: Bool[Array, " q"],
) -> Float[Array, "n 4"]:
    ends_at, beside_at, corners_at = (coordinates_of(x, flat) for x in (ends, beside, corners))
    p, q, *thirds = (tuple(at[:, k]) for at in (ends_at, beside_at) for k in range(2))
    a, b, c = (tuple(corners_at[:, k]) for k in range(3))
    normal = _unit(cross(minus(b, a), minus(c, a)))
    d = minus(q, p)
    along = _unit(d)
    steep = dot(along, normal)
    steep = jnp.where(jnp.abs(steep) < STEEP, jnp.where(steep < 0, -STEEP, STEEP), steep)
    to: Vector = tuple(jnp.zeros_like(x) for x in p)
    for third in thirds:
        way = minus(third, p)
        inward = _unit(cross(normal, cross(d, way)))  # where the face and the edge's own face meet
        side = jnp.sign(dot(inward, minus(way, _times(along, dot(along, way)))))
        back = 2 * dot(along, inward) / steep
        to = tuple(x + side * (y - back * n) for x, y, n in zip(to, inward, normal, strict=True))
    size = jax.lax.rsqrt(dot(to, to) + 1.0)
    to = _times(to, jnp.where(there, size, 0.0))
    forth, back = (jnp.stack([*_times(to, sign), there.astype(size.dtype)], axis=-1) for sign in (1.0, -1.0))
    one, two = dot(normal, minus(p, a)), dot(normal, minus(q, a))
    t = one / jnp.where(there, one - two, 1.0)
    volumes = [dot(cross(d, minus(s, p)), minus(t, p)) for s, t in ((b, c), (c, a), (a, b))]
    total = jnp.where(there, sum(volumes), 1.0)
    for vertex, part in zip(ends, (1 - t, t), strict=True):
        push = push.at[vertex].add(part[:, None] * forth)
    for vertex, volume in zip(corners, volumes, strict=True):
        push = push.at[vertex].add((volume / total)[:, None] * back)
    return push


def _unit(x: Vector) -> Vector:
    return _times(x, 1 / jnp.maximum(jnp.sqrt(dot(x, x)), 1e-20))


def _times(x: Vector, by: Array | float) -> Vector:
    return tuple(y * by for y in x)
