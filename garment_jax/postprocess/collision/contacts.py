"""Contacts between garment and body: nearest points and signed distances, the constraints of section 3.5.

A vertex that was outside in the last frame must cross the surface to be inside now. So it is searched only
as far as it and the surface can have moved against each other; with nothing that near it is outside.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from garment_jax.geometry.bitset import WORD, in_chunks
from garment_jax.geometry.closest_point import signed_on
from garment_jax.geometry.gather import coordinates_of, gathered
from garment_jax.geometry.noinline import fusion_barrier, noinline
from garment_jax.geometry.surface_search import (
    SLACK,
    PosedSurface,
    distance_to,
    search,
)
from garment_jax.geometry.triangle import dot, squared_length
from garment_jax.postprocess.collision.tables import CollisionTables

Boxes = tuple[Float[Array, "3 g"], Float[Array, "3 g"]]  # least and greatest coordinates, metres
Movement = tuple[Float[Array, "3 g"], Float[Array, " g"]]  # mean step and how far a step differs from it
ANSWERS = 128  # vertices whose correspondence is made at a time
TOGETHER = 8  # of them that search as a group where few search again
BRANCHES = 64  # of the surface that are compared with all groups at a time
PATCH = 32  # groups in a row, which lie together, in one box where branches are left out


class Contacts(NamedTuple):
    """What is known of `m` vertices against one frame's surface, relative to its origin, metres."""

    triangle: jax.Array  # [m] int32 row of the surface tables, near the vertex
    ds: jax.Array  # [m] signed distance where `known`, and a lower bound of it elsewhere
    known: jax.Array  # [m] bool: point, direction and ds are exact
    point: jax.Array  # [3, m] closest point
    direction: jax.Array  # [3, m] unit gradient of ds; 0 where not known


@noinline
def crossing_limit(
    grouped: Float[Array, "3 s g"],
    moved: Float[Array, "3 n"],
    its: Float[Array, "3 c"],
    surface: PosedSurface,
    tables: CollisionTables,
) -> Float[Array, " n"]:
    """Return how near the surface must be to a vertex that was outside for it to be inside now (metres).

    If it crossed a part of the surface on a straight way since the last frame, it lies where that part would
    be had it gone on, as far as the two have `moved` against each other at most (`its`: the surface): within
    the part's box and between its planes, both drawn along that movement. So what slides along the body is
    not searched.
    """
    ours, body = _movement(moved.reshape(-1), tables.groups.T), its.reshape(-1)
    low, high, middle, half = _boxes(grouped)

    limit = in_chunks(
        _met((low, high), ours, its, surface),
        lambda which, _, limit: _past(which, limit, (middle, half), ours, body, surface, tables),
        jnp.zeros_like(ours[1]),
        BRANCHES,
    )
    return limit[jnp.asarray(tables.group)]


@noinline
def _boxes(grouped: Float[Array, "3 s g"]) -> tuple[Array, Array, Array, Array]:
    """Return least and greatest coordinates of the groups, and middles and half edges, `[3, g]` each."""
    low, high = grouped.min(axis=1), grouped.max(axis=1)
    return low, high, (low + high) / 2, (high - low) / 2


@noinline
def _past(
    which: Int[Array, " k"],
    limit: Float[Array, " g"],
    groups: Boxes,
    ours: Movement,
    body: Float[Array, " c3"],
    surface: PosedSurface,
    tables: CollisionTables,
) -> Array:
    """Return the greater of `limit` and `crossing_limit` past some branches."""
    low, high = surface.low[:, which], surface.high[:, which]
    branch = (low + high) / 2, (high - low) / 2
    its = _movement(body, jnp.asarray(tables.surface.branches.T)[:, which])
    return _group_limit(groups, branch, ours, its, surface.branch_slab[:, which], limit)


@noinline
def _met(boxes: Boxes, ours: Movement, its: Float[Array, "3 c"], surface: PosedSurface) -> Bool[Array, " b"]:
    """Return the branches that some group may have met: within a patch's box, drawn along all movement."""
    fill = ((0, 0), (0, -boxes[0].shape[1] % PATCH))
    low, high = (jnp.pad(x, fill, mode="edge").reshape(3, -1, PATCH) for x in boxes)
    # the least and greatest steps of every q-th vertex `[3, q]`: in two goes they vectorise
    steps = jnp.pad(its, ((0, 0), (0, -its.shape[1] % WORD)), mode="edge").reshape(3, WORD, -1)
    extremes = steps.min(axis=1), steps.max(axis=1)
    return _met_by((low.min(axis=2), high.max(axis=2)), ours, extremes, surface)


@noinline
def _met_by(
    patches: tuple[Float[Array, "3 p"], Float[Array, "3 p"]],
    ours: Movement,
    its: tuple[Float[Array, "3 q"], Float[Array, "3 q"]],
    surface: PosedSurface,
) -> Bool[Array, " b"]:
    """Return the branches within some patch's box, drawn along the extremes of either's movement."""
    step, reach = ours
    back = jnp.maximum((step + reach[None]).max(axis=1) - its[0].min(axis=1), 0.0) + SLACK
    ahead = jnp.maximum(its[1].max(axis=1) - (step - reach[None]).min(axis=1), 0.0) + SLACK
    low, high = (patches[0] - back[:, None])[..., None], (patches[1] + ahead[:, None])[..., None]
    return ((low <= surface.high[:, None]) & (high >= surface.low[:, None])).all(axis=0).any(axis=0)


def collider_of(surface: PosedSurface) -> Float[Array, "3 c"]:
    """Return the vertices of a surface, coordinates first, metres, in the frame in which it was given."""
    return surface.flat.reshape(3, -1) + surface.origin[:, None]


@noinline
def _group_limit(
    group: Boxes,
    branch: tuple[Float[Array, "3 b"], Float[Array, "3 b"]],
    ours: Movement,
    its: tuple[Float[Array, "3 b"], Float[Array, " b"]],
    slab: Float[Array, "5 b"],
    limit: Float[Array, " g"],
) -> Float[Array, " g"]:
    """Return `crossing_limit` of every group past some branches, of boxes and movements (`_movement`).

    At least `limit`.
    """
    (middle, half), (centre, extent), (step, reach), (branch_step, branch_reach) = group, branch, ours, its
    way = tuple(step[x][None] - branch_step[x][:, None] for x in range(3))  # of the group, past the branch
    spare = reach[None] + branch_reach[:, None]

    n = slab[:3, :, None]
    pairs = [(dot(n, middle[:, None]) - slab[3][:, None], dot(jnp.abs(n), half[:, None]) + slab[4][:, None])]
    pairs += [(middle[x][None] - centre[x][:, None], half[x][None] + extent[x][:, None]) for x in range(3)]
    crossed = jnp.array(True)
    for (apart, sizes), along in zip(pairs, (dot(n, way), *way), strict=True):
        # [-size, size] with one end drawn along, and spare at both
        crossed &= jnp.abs(apart - 0.5 * along) <= sizes + spare + 0.5 * jnp.abs(along)
    far = jnp.where(crossed, jnp.sqrt(squared_length(way)) + spare, 0.0)
    # none is below 0, so their bits are in the same order: an integer maximum vectorises
    bits = jnp.int64 if far.dtype == jnp.float64 else jnp.int32
    greatest = jax.lax.bitcast_convert_type(far, bits).max(axis=0)
    return jnp.maximum(limit, jax.lax.bitcast_convert_type(greatest, far.dtype))


@noinline
def _movement(flat: Float[Array, " n3"], points: Int[Array | np.ndarray, "k b"]) -> Movement:
    """Return the mean step `[3, b]` of `k` points each and how far a step differs from it at most `[b]`."""
    steps = coordinates_of(points, flat)
    mean = fusion_barrier(steps.mean(axis=1))
    return mean, jnp.sqrt(squared_length(steps - mean[:, None]).max(axis=0))


@noinline
def find_contacts(
    local: Float[Array, "3 n"],
    grouped: Float[Array, "3 s g"],
    last: Int[Array, " n"],
    limit: Float[Array, " n"],
    surface: PosedSurface,
    tables: CollisionTables,
) -> Contacts:
    """Return the contacts of a frame's vertices, all that are asked for (`limit` >= 0); `last`: triangles.

    Exact where the surface is within `limit`; a vertex with nothing so near must be known to be outside,
    and then is so by `limit`. `grouped` are the same vertices in their groups.
    """
    distance = distance_to(last, local, surface, tables.surface)
    within = gathered(jnp.where(limit >= 0, jnp.minimum(limit, distance), -1.0), tables.groups.T)
    found = search(grouped, within, surface).triangle
    contacts = _without_answers(found, last, limit, tables)

    return in_chunks(
        contacts.known,
        lambda here, to, made: made._replace(
            **_answered(made, to, made.triangle[here], local[:, here], surface, tables)
        ),
        contacts,
        ANSWERS,
    )


@noinline
def _without_answers(
    found: Int[Array, "s g"], last: Int[Array, " n"], limit: Float[Array, " n"], tables: CollisionTables
) -> Contacts:
    """Return the contacts of the vertices whose triangles were `found`, but for points and directions."""
    found = found.reshape(-1)[jnp.asarray(tables.slot)]  # padding repeats a vertex, within its own group
    near, nowhere = found >= 0, jnp.zeros((3, len(found)), limit.dtype)
    ds = jnp.where((limit >= 0) & ~near, limit, 0.0)
    return Contacts(jnp.where(near, found, last), ds, near, nowhere, nowhere)


@noinline
def find_again(
    local: Float[Array, "3 n"],
    at: Contacts,
    limit: Float[Array, " n"],
    surface: PosedSurface,
    tables: CollisionTables,
) -> Contacts:
    """Return contacts `at` with those asked for (`limit` >= 0) made anew; the rest stays as it was.

    For a second search in a frame, where those asked are few: the next ones in order search together, and
    should lie together. Exact as `find_contacts`.
    """

    def chunk(here: Array, to: Array, made: Contacts) -> Contacts:
        last, points, within = _asked(here, to, local, made.triangle, limit, surface, tables)
        found = search_few(points, within, surface, tables)
        return _noted(made, here, to, last, found, points, limit, surface, tables)

    return in_chunks(limit >= 0, chunk, at, ANSWERS)


@noinline
def _asked(
    here: Int[Array, " k"],
    to: Int[Array, " k"],
    local: Float[Array, "3 n"],
    triangle: Int[Array, " n"],
    limit: Float[Array, " n"],
    surface: PosedSurface,
    tables: CollisionTables,
) -> tuple[Array, Array, Array]:
    """Return triangles and places of the vertices `here`, and how far they search: what fills up does not."""
    last, points = triangle[here], local[:, here]
    distance = distance_to(last, points, surface, tables.surface)
    return last, points, jnp.where(to < len(limit), jnp.minimum(limit[here], distance), -1.0)


@noinline
def search_few(
    points: Float[Array, "3 k"], within: Float[Array, " k"], surface: PosedSurface, tables: CollisionTables
) -> Int[Array, " k"]:
    """Return the triangles nearest to points `within` their limits, -1 where there is none.

    Those that follow each other search together.
    """
    grouped = points.reshape(3, -1, TOGETHER).transpose(0, 2, 1)
    found = search(grouped, within.reshape(-1, TOGETHER).T, surface, at_once=ANSWERS)
    return found.triangle.T.reshape(-1)


@noinline
def _noted(
    made: Contacts,
    here: Int[Array, " k"],
    to: Int[Array, " k"],
    last: Int[Array, " k"],
    found: Int[Array, " k"],
    points: Float[Array, "3 k"],
    limit: Float[Array, " n"],
    surface: PosedSurface,
    tables: CollisionTables,
) -> Contacts:
    """Return the contacts with those of the vertices `here`: what they `found`, or that they are far."""
    near = found >= 0
    triangle, far = jnp.where(near, found, last), jnp.where(near, len(limit), to)
    made = made._replace(**_answered(made, to, triangle, points, surface, tables))
    return made._replace(
        triangle=made.triangle.at[to].set(triangle, mode="drop"),
        ds=made.ds.at[far].set(limit[here], mode="drop"),
        known=made.known.at[to].set(near, mode="drop"),
    )


@noinline
def _answered(
    made: Contacts,
    to: Int[Array, " k"],
    triangle: Int[Array, " k"],
    points: Float[Array, "3 k"],
    surface: PosedSurface,
    tables: CollisionTables,
) -> dict[str, Array]:
    """Return the contacts' answers with those of `points` on their triangles, written `to` their places."""
    answer = signed_on(triangle, points, surface, tables.surface)
    return {
        "ds": made.ds.at[to].set(answer.ds, mode="drop"),
        "point": made.point.at[:, to].set(answer.point, mode="drop"),
        "direction": made.direction.at[:, to].set(answer.direction, mode="drop"),
    }
