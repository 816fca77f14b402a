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
from garment_jax.geometry.closest_point import closest_point_on
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

ANSWERS = 128  # vertices whose correspondence is made at a time


class Contacts(NamedTuple):
    """What is known of `m` vertices against one frame's surface, relative to its origin, metres."""

    triangle: jax.Array  # [m] int32 row of the surface tables, near the vertex
    ds: jax.Array  # [m] signed distance where `known`, and a lower bound of it elsewhere
    known: jax.Array  # [m] bool: point, direction and ds are exact
    point: jax.Array  # [m, 3] closest point
    direction: jax.Array  # [m, 3] unit gradient of ds; 0 where not known


def branch_gaps(
    local: Float[Array, "n 3"], surface: PosedSurface, tables: CollisionTables
) -> Float[Array, "g w"]:
    """Return the squared distances of the groups' boxes to the branches'."""
    groups = jnp.asarray(tables.groups)
    points = local.T[:, groups].transpose(1, 0, 2)
    return branch_gap_squared(*group_boxes(points, jnp.ones(groups.shape, bool)), surface)


def crossing_limit(
    gap_squared: Float[Array, "g w"],
    V: Float[Array, "n 3"],
    state: CollisionState,
    surface: PosedSurface,
    tables: CollisionTables,
) -> Float[Array, " n"]:
    """Return how near the surface must be to a vertex that was outside for it to be inside now (metres).

    If it crossed a part of the surface on a straight way since the last frame, it is no farther from
    that part than the two have moved against each other.
    """
    step, reach = _movement(V - state.V, jnp.asarray(tables.groups))
    body = surface.vertices + surface.origin[None] - state.collider
    branch_step, branch_reach = _movement(body, jnp.asarray(tables.surface.branches))
    apart = jnp.zeros(())
    for x in range(3):
        apart = apart + (step[x, :, None] - branch_step[x][None]) ** 2
    apart = jnp.sqrt(apart) + reach[:, None] + branch_reach[None]
    gap_squared = gap_squared[:, : len(branch_reach)]
    return of_group(jnp.where(gap_squared <= apart * apart, apart, 0.0).max(axis=1), tables)


def of_group(values: Array, tables: CollisionTables) -> Array:
    """Return the value `[n]` of each vertex' group, of `[g]`."""
    return values[jnp.asarray(tables.group)]


def probed(frame: Int[Array, ""], tables: CollisionTables) -> Bool[Array, " n"]:
    """Return the vertices searched in this frame whatever is known: every one once in s^2 frames."""
    s = tables.groups.shape[1]
    return jnp.asarray(tables.turn) == s * (frame % s) + (frame // s) % s


def _movement(steps: Float[Array, "n 3"], points: Int[Array, "b k"]) -> tuple[Array, Array]:
    """Return the mean step `[3, b]` of `k` points each and how far a step differs from it at most `[b]`."""
    flat = materialised(steps.T).reshape(-1)
    steps = materialised(coordinates_of(points.T, flat))  # gathered once, not for both reductions
    mean = steps.mean(axis=1)
    return mean, jnp.sqrt(((steps - mean[:, None]) ** 2).sum(axis=0).max(axis=0))


def find_contacts(
    local: Float[Array, "n 3"],
    last: Contacts,
    limit: Float[Array, " n"],
    moved: Float[Array, " n"],
    gap_squared: Float[Array, "g w"],
    surface: PosedSurface,
    tables: CollisionTables,
) -> Contacts:
    """Return the contacts with those asked for (`limit` >= 0) made anew; the rest stays as it was.

    `moved`: how far each vertex is from where `gap_squared` was taken (`branch_gaps`).
    Exact where the surface is within `limit`; a vertex with nothing so near must be known to be outside,
    and then is so by `limit`.
    """
    asked, groups = limit >= 0, jnp.asarray(tables.groups)
    bound = distance_to(last.triangle, local, surface, tables.surface)
    bound = jnp.where(asked, jnp.minimum(limit, bound), -1.0)
    here = bound[groups]
    widest = jnp.where(here < 0, -1.0, here + moved[groups]).max(axis=1)
    words = branches_within(gap_squared, widest)
    found = search(local[groups], here, surface, tables.surface, words).triangle
    found = found.reshape(-1)[jnp.asarray(tables.slot)]  # padding repeats a vertex, within its own group
    near = found >= 0
    triangle = jnp.where(near, found, last.triangle)
    ds = jnp.where(asked & ~near, limit, last.ds)
    known = jnp.where(asked, near, last.known)
    return _answers(Contacts(triangle, ds, known, last.point, last.direction), near, local, surface, tables)


def _answers(contacts, wanted: Bool[Array, " n"], local, surface, tables: CollisionTables) -> Contacts:
    """Return the contacts with the wanted correspondences made, a chunk at a time: few are wanted."""
    n = len(local)
    words = pack_words(jnp.pad(wanted, (0, -n % WORD)).reshape(-1, 1, WORD))
    up_to = marked_up_to(words)

    def chunk(state):
        at, made = state
        word, bit, valid = select(at, ANSWERS, words, up_to)
        which = jnp.where(valid, word * WORD + bit, n)
        here = jnp.minimum(which, n - 1)
        answer = closest_point_on(made.triangle[here], local[here], surface, tables.surface)
        ds = made.ds.at[which].set(answer.ds, mode="drop")
        point = made.point.at[which].set(answer.point - surface.origin[None], mode="drop")
        direction = made.direction.at[which].set(answer.direction, mode="drop")
        return at + ANSWERS, made._replace(ds=ds, point=point, direction=direction)

    return jax.lax.while_loop(lambda state: state[0] < up_to[-1], chunk, (jnp.int32(0), contacts))[1]
