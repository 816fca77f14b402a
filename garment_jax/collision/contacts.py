"""Which vertices are near the body, and where: the constraints of section 3.5, frame after frame.

A vertex that was outside must cross the surface to get in, so only what lies within its own and the
surface's movement has to be searched; the others are outside without a question. Where two parts of the
body cross each other the sign of a distance is ambiguous and the proof may rest on the wrong one: in every
frame a few vertices are searched all the same, in turn.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from garment_jax.collision.result import CollisionState
from garment_jax.collision.tables import CollisionTables
from garment_jax.geometry.closest_point import signed_on
from garment_jax.geometry.marked import WORD, marked_up_to, pack_words, select
from garment_jax.geometry.stencil import materialised
from garment_jax.geometry.surface_search import (
    PosedSurface,
    branch_gap_squared,
    branches_within,
    coordinates_of,
    distance_to,
    group_boxes,
    search,
)
from garment_jax.geometry.triangle import dot, squared_length

Boxes = tuple[Float[Array, "3 g"], Float[Array, "3 g"]]  # least and greatest coordinates, metres
ANSWERS = 128  # vertices whose correspondence is made at a time


class Contacts(NamedTuple):
    """What is known of `m` vertices against one frame's surface, relative to its origin, metres."""

    triangle: jax.Array  # [m] int32 row of the surface tables, near the vertex
    ds: jax.Array  # [m] signed distance where `known`, and a lower bound of it elsewhere
    known: jax.Array  # [m] bool: point, direction and ds are exact
    point: jax.Array  # [3, m] closest point
    direction: jax.Array  # [3, m] unit gradient of ds; 0 where not known


def in_groups(local: Float[Array, "3 n"], tables: CollisionTables) -> Float[Array, "3 s g"]:
    """Return the vertices of the groups, the groups last."""
    return materialised(coordinates_of(jnp.asarray(tables.groups).T, local.reshape(-1)))


def boxes_of(grouped: Float[Array, "3 s g"]) -> Boxes:
    """Return the least and the greatest coordinates of the groups."""
    return materialised(group_boxes(grouped, jnp.ones(grouped.shape[1:], bool)))


def crossing_limit(
    boxes: Boxes,
    moved: Float[Array, "3 n"],
    state: CollisionState,
    surface: PosedSurface,
    tables: CollisionTables,
) -> Float[Array, " n"]:
    """Return how near the surface must be to a vertex that was outside for it to be inside now (metres).

    If it crossed a part of the surface on a straight way since the last frame, it lies where that part would
    be had it gone on, as far as the two have `moved` against each other at most: within the part's box and
    between its planes, both drawn along that movement. So what slides along the body is not searched.
    """
    step, reach = _movement(moved, jnp.asarray(tables.groups))
    body = surface.flat.reshape(3, -1) + surface.origin[:, None] - state.collider
    branch_step, branch_reach = _movement(body, jnp.asarray(tables.surface.branches))
    low, high = boxes
    middle, half = materialised(((low + high) / 2, (high - low) / 2))
    centre, extent = (surface.low + surface.high) / 2, (surface.high - surface.low) / 2
    way = tuple(step[x][None] - branch_step[x][:, None] for x in range(3))  # of the group, past the branch
    spare = reach[None] + branch_reach[:, None]

    def meet(apart, sizes, along) -> Array:  # [-size, size] with one end drawn along, and spare at both
        return jnp.abs(apart - 0.5 * along) <= sizes + spare + 0.5 * jnp.abs(along)

    n = surface.branch_slab[:3, :, None]
    sizes = dot(jnp.abs(n), half[:, None]) + surface.branch_slab[4][:, None]
    crossed = meet(dot(n, middle[:, None]) - surface.branch_slab[3][:, None], sizes, dot(n, way))
    for x in range(3):
        sizes = half[x][None] + extent[x][:, None]
        crossed = crossed & meet(middle[x][None] - centre[x][:, None], sizes, way[x])
    limit = greatest(jnp.where(crossed, jnp.sqrt(squared_length(way)) + spare, 0.0))
    return of_group(materialised(limit), tables)  # or it is looked for by every vertex


def greatest(x: Float[Array, "b g"]) -> Float[Array, " g"]:
    """Return the maximum of each column of numbers >= 0, by their bits: an integer maximum vectorises."""
    kind, same = (jnp.int64, x) if x.dtype == jnp.float64 else (jnp.int32, x.astype(jnp.float32))
    bits = jax.lax.bitcast_convert_type(same, kind).max(axis=0)
    return jax.lax.bitcast_convert_type(bits, same.dtype).astype(x.dtype)


def of_group(values: Array, tables: CollisionTables) -> Array:
    """Return the value `[n]` of each vertex' group, of `[g]`."""
    return values[jnp.asarray(tables.group)]


def probed(frame: Int[Array, ""], tables: CollisionTables) -> Bool[Array, " n"]:
    """Return the vertices searched in this frame whatever is known: every one once in s^2 frames."""
    s = tables.groups.shape[1]
    return jnp.asarray(tables.turn) == s * (frame % s) + (frame // s) % s


def _movement(steps: Float[Array, "3 n"], points: Int[Array, "b k"]) -> tuple[Array, Array]:
    """Return the mean step `[3, b]` of `k` points each and how far a step differs from it at most `[b]`."""
    flat = materialised(steps).reshape(-1)
    steps = materialised(coordinates_of(points.T, flat))  # gathered once, not for both reductions
    mean = materialised(steps.mean(axis=1))
    off = steps - mean[:, None]
    return materialised((mean, jnp.sqrt(squared_length(off).max(axis=0))))  # once, not for every pair


def find_contacts(
    local: Float[Array, "3 n"],
    grouped: Float[Array, "3 s g"],
    last: Int[Array, " n"],
    limit: Float[Array, " n"],
    boxes: Boxes,
    surface: PosedSurface,
    tables: CollisionTables,
) -> Contacts:
    """Return the contacts of a frame's vertices, all that are asked for (`limit` >= 0); `last`: triangles.

    Exact where the surface is within `limit`; a vertex with nothing so near must be known to be outside,
    and then is so by `limit`. `grouped` are the same vertices (`in_groups`), `boxes` theirs.
    """
    asked, groups = limit >= 0, jnp.asarray(tables.groups).T
    bound = distance_to(last, local, surface, tables.surface)
    bound = materialised(jnp.where(asked, jnp.minimum(limit, bound), -1.0))
    here = bound[groups]
    words = branches_within(branch_gap_squared(*boxes, surface), materialised(here.max(axis=0)))
    found = search(grouped, here, surface, tables.surface, words).triangle
    found = found.reshape(-1)[jnp.asarray(tables.slot)]  # padding repeats a vertex, within its own group
    near, nowhere = found >= 0, jnp.zeros_like(local)
    triangle = jnp.where(near, found, last)
    contacts = Contacts(triangle, jnp.where(asked & ~near, limit, 0.0), near, nowhere, nowhere)

    def chunk(here: Array, to: Array, made: Contacts) -> Contacts:
        return _answered(made, here, to, made.triangle[here], local[:, here], surface, tables)

    return _in_chunks(near, chunk, contacts)


def find_again(
    local: Float[Array, "3 n"],
    at: Contacts,
    limit: Float[Array, " n"],
    surface: PosedSurface,
    tables: CollisionTables,
) -> Contacts:
    """Return contacts `at` with those asked for (`limit` >= 0) made anew; the rest stays as it was.

    For a second search in a frame: those asked are few, and each looks for itself. Exact as `find_contacts`.
    """

    def chunk(here: Array, to: Array, made: Contacts) -> Contacts:
        points, last = materialised((local[:, here], made.triangle[here]))
        bound = jnp.minimum(limit[here], distance_to(last, points, surface, tables.surface))
        bound = materialised(jnp.where(to < len(limit), bound, -1.0))
        found = search(points[:, None], bound[None], surface, tables.surface).triangle[0]
        near = found >= 0
        triangle = jnp.where(near, found, last)
        new = _answered(made, here, to, triangle, points, surface, tables)
        far = jnp.where(near, len(limit), to)
        return new._replace(
            triangle=made.triangle.at[to].set(triangle, mode="drop"),
            ds=new.ds.at[far].set(limit[here], mode="drop"),
            known=made.known.at[to].set(near, mode="drop"),
        )

    return _in_chunks(limit >= 0, chunk, at)


def _in_chunks(wanted: Bool[Array, " n"], chunk, contacts: Contacts) -> Contacts:
    """Return the contacts after `chunk(vertices, where to write, contacts)` for all that are wanted.

    `ANSWERS` at a time: few are wanted. What fills up the last chunk is written nowhere (to n).
    """
    n = len(wanted)
    words = pack_words(jnp.pad(wanted, (0, -n % WORD)).reshape(-1, 1, WORD))
    up_to = marked_up_to(words)

    def one(state):
        at, made = state
        word, bit, valid = select(at, ANSWERS, words, up_to)
        to = materialised(jnp.where(valid, word * WORD + bit, n))
        return at + ANSWERS, chunk(materialised(jnp.minimum(to, n - 1)), to, made)

    return jax.lax.while_loop(lambda state: state[0] < up_to[-1], one, (jnp.int32(0), contacts))[1]


def _answered(made: Contacts, here, to, triangle, points, surface, tables: CollisionTables) -> Contacts:
    """Return the contacts with the vertices `here` answered on their triangles, written `to` their places."""
    answer = signed_on(triangle, tuple(points), surface, tables.surface)
    ds = made.ds.at[to].set(answer.ds, mode="drop")
    point, direction = (
        old.at[:, to].set(jnp.stack(new), mode="drop")
        for old, new in ((made.point, answer.point), (made.direction, answer.direction))
    )
    return made._replace(ds=ds, point=point, direction=direction)
