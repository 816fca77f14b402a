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
from garment_jax.geometry.closest_point import closest_point_on
from garment_jax.geometry.marked import WORD, marked_up_to, pack_words, select
from garment_jax.geometry.surface_search import (
    PosedSurface,
    box_gap_squared,
    distance_to,
    group_boxes,
    search,
)
from garment_jax.geometry.surface_tables import BRANCH, LEAF, SurfaceTables

ANSWERS = 256  # vertices whose correspondence is made at a time


class Contacts(NamedTuple):
    """What is known of `m` vertices against one frame's surface, relative to its origin, metres."""

    triangle: jax.Array  # [m] int32 row of the surface tables, near the vertex
    ds: jax.Array  # [m] signed distance where `known`, and a lower bound of it elsewhere
    known: jax.Array  # [m] bool: point, direction and ds are exact
    point: jax.Array  # [m, 3] closest point
    direction: jax.Array  # [m, 3] unit gradient of ds; 0 where not known


def crossing_limit(
    V: Float[Array, "n 3"],
    state: CollisionState,
    surface: PosedSurface,
    tables: SurfaceTables,
    groups: Int[Array, "g s"],
) -> Float[Array, " n"]:
    """Return how near the surface must be to a vertex that was outside for it to be inside now (metres).

    If it crossed a part of the surface on a straight way since the last frame, it is no farther from
    that part than the two have moved against each other.
    """
    step, reach = _movement((V - state.V)[groups].transpose(1, 0, 2))
    body = surface.vertices + surface.origin[None] - state.collider
    faces = jnp.asarray(tables.faces).reshape(-1, 3 * LEAF * BRANCH)
    branch_step, branch_reach = _movement(body[faces.T])
    low, high = surface.middle - surface.half, surface.middle + surface.half
    low, high = low.reshape(-1, BRANCH, 3).min(axis=1), high.reshape(-1, BRANCH, 3).max(axis=1)
    local = (V - surface.origin[None])[groups]
    middle, half = group_boxes(local, jnp.ones(groups.shape, bool))
    gap = box_gap_squared(middle[:, None], half[:, None], (low + high)[None] / 2, (high - low)[None] / 2)
    apart = step[:, None] - branch_step[None]
    apart = jnp.sqrt((apart * apart).sum(axis=-1)) + reach[:, None] + branch_reach[None]
    limit = jnp.where(gap <= apart * apart, apart, 0.0).max(axis=1)
    # padding repeats a vertex, within its own group
    return jnp.zeros(len(V), V.dtype).at[groups].set(jnp.broadcast_to(limit[:, None], groups.shape))


def probed(frame: Int[Array, ""], groups: Int[Array, "g s"], n: int) -> Bool[Array, " n"]:
    """Return the vertices searched in this frame whatever is known: every one once in s^2 frames."""
    g, s = groups.shape
    turn = (jnp.arange(g) % s) == frame % s
    which = jnp.where(turn, groups[:, (frame // s) % s], n)
    return jnp.zeros(n, bool).at[which].set(True, mode="drop")


def _movement(steps: Float[Array, "k b 3"]) -> tuple[Array, Array]:
    """Return the mean step `[b, 3]` of `k` points each and how far a step differs from it at most `[b]`."""
    mean = steps.mean(axis=0)
    return mean, jnp.sqrt(((steps - mean[None]) ** 2).sum(axis=-1).max(axis=0))


def find_contacts(
    local: Float[Array, "m 3"],
    last: Contacts,
    limit: Float[Array, " m"],
    groups: Int[Array, "g s"],
    surface: PosedSurface,
    tables: SurfaceTables,
) -> Contacts:
    """Return the contacts with those asked for (`limit` >= 0) made anew; the rest stays as it was.

    Exact where the surface is within `limit`; a vertex with nothing so near must be known to be outside,
    and then is so by `limit`.
    """
    asked = limit >= 0
    bound = jnp.where(asked, jnp.minimum(limit, distance_to(last.triangle, local, surface)), -1.0)
    found = search(local[groups], bound[groups], surface)
    triangle = last.triangle.at[groups].set(
        jnp.where(found.triangle < 0, last.triangle[groups], found.triangle)
    )
    near = jnp.zeros(len(local), bool).at[groups].set(found.triangle >= 0)
    ds = jnp.where(asked & ~near, limit, last.ds)
    known = jnp.where(asked, near, last.known)
    return _answers(Contacts(triangle, ds, known, last.point, last.direction), near, local, surface, tables)


def _answers(contacts, wanted: Bool[Array, " m"], local, surface, tables) -> Contacts:
    """Return the contacts with the wanted correspondences made, a chunk at a time: few are wanted."""
    m = len(local)
    words = pack_words(jnp.pad(wanted, (0, -m % WORD)).reshape(-1, 1, WORD))
    up_to = marked_up_to(words)

    def chunk(state):
        at, made = state
        word, bit, valid = select(at, ANSWERS, words, up_to)
        which = jnp.where(valid, word * WORD + bit, m)
        here = jnp.minimum(which, m - 1)
        answer = closest_point_on(made.triangle[here], local[here], surface, tables)
        ds = made.ds.at[which].set(answer.ds, mode="drop")
        point = made.point.at[which].set(answer.point - surface.origin[None], mode="drop")
        direction = made.direction.at[which].set(answer.direction, mode="drop")
        return at + ANSWERS, made._replace(ds=ds, point=point, direction=direction)

    return jax.lax.while_loop(lambda state: state[0] < up_to[-1], chunk, (jnp.int32(0), contacts))[1]
