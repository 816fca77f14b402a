"""Inside or outside, also where parts of the body cross each other: signs by winding number.

Where two thighs overlap, the nearest triangle may lie inside the other thigh, and its pseudo-normal gives the
wrong sign. Inside is what the surface encloses once or more (winding number >= 1): the union of the parts.
A triangle bounds the union where the winding number on its outer side is 0. No triangle lies between a vertex
and its nearest one, so the vertex' own winding number decides: 0 in front of a bounding triangle, 1 behind
it. A vertex whose nearest triangle bounds nothing gets the nearest one that does. Not in the paper.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from garment_jax.geometry.bitset import in_chunks
from garment_jax.geometry.closest_point import Signed, signed_on
from garment_jax.geometry.gather import scattered
from garment_jax.geometry.noinline import fusion_barrier, noinline
from garment_jax.geometry.ray_winding import winding_by_ray
from garment_jax.geometry.surface_search import SLACK, PosedSurface
from garment_jax.geometry.surface_tables import LEAF
from garment_jax.geometry.triangle import dot
from garment_jax.postprocess.collision.contacts import Contacts, search_few
from garment_jax.postprocess.collision.tables import CollisionTables

RAYS = 128  # vertices whose rays are counted together
MANY = 256  # vertices from which on one speaks for its group
SURE = 0.999  # of the distance to the surface within which it does
BESIDE = 1e-5  # metres beyond a sheet at which its outer side is looked at
TOUCHING = 1e-6  # metres: so near to a sheet a vertex is on it, and its direction the sheet's
REACH = 0.03  # metres from a vertex within which a sheet that bounds is looked for first
WIDEST = 4.0  # metres: where none is found, the vertex is left with the nearest of all
_NOWHERE = 1e15  # metres: its square is finite


@noinline
def sided(
    at: Contacts,
    asked: Bool[Array, " m"],
    local: Float[Array, "3 m"],
    surface: PosedSurface,
    tables: CollisionTables,
) -> tuple[Contacts, Bool[Array, ""]]:
    """Return contacts `at` of `local`, those `asked` for on their side of the union of the body's parts.

    The others, and all whose nearest sheet bounds the union, stay bitwise; so do all of a surface with a
    border, which has no inside. A triangle that bounds it with a part of itself counts as one that does not:
    a depth may be too large by as much as such a triangle is long, never too small. Also whether there was
    any whose nearest sheet does not bound it.
    """
    if len(tables.surface.border):
        return at, jnp.array(False)
    asked = asked & at.known
    number = _numbers(asked, at, local, surface, tables)
    # by the winding numbers; on its sheet a vertex has none, there it is that of the sheet's outer side
    misled = asked & (number != (at.ds < -BESIDE))
    return _bounding(at, number, misled, local, surface, tables), misled.any()


def _numbers(
    asked: Bool[Array, " m"],
    at: Contacts,
    local: Float[Array, "3 m"],
    surface: PosedSurface,
    tables: CollisionTables,
) -> Int[Array, " m"]:
    """Return the winding numbers around the vertices `asked` for.

    Where they are many, one vertex speaks for those of its group that are nearer to it than the surface.
    """
    itself = jnp.arange(len(asked), dtype=jnp.int32)
    speaker, rays = jax.lax.cond(
        asked.sum() > MANY, lambda: _speakers(at, asked, local, tables), lambda: (itself, asked)
    )

    def chunk(here: Array, to: Array, number: Array) -> Array:
        point, direction, ds = at.point[:, here], at.direction[:, here], at.ds[here]
        start = jnp.where((jnp.abs(ds) > BESIDE)[None], local[:, here], point + BESIDE * direction)
        # ahead: away from the sheet
        found = winding_by_ray(start, direction[2] >= 0, to < len(asked), surface, tables.surface)
        return number.at[to].set(found, mode="drop")

    return in_chunks(rays, chunk, jnp.zeros(len(asked), jnp.int32), RAYS)[speaker]


@noinline
def _speakers(
    at: Contacts, asked: Bool[Array, " m"], local: Float[Array, "3 m"], tables: CollisionTables
) -> tuple[Array, Array]:
    """Return whose winding number is each one's, and the vertices that are looked at.

    That is the vertex of its group that is farthest from the surface, where that is farther than from here
    to there, and else itself. What nobody has found within a distance is outside, and farther.
    """
    room = jnp.where(at.known, jnp.abs(at.ds), jnp.maximum(at.ds, 0.0))
    groups = jnp.asarray(tables.groups.T)
    first = fusion_barrier(room)[groups].argmax(axis=0).astype(jnp.int32)
    farthest = groups.T.reshape(-1)[first + groups.shape[0] * jnp.arange(groups.shape[1], dtype=jnp.int32)]
    speaker = farthest[jnp.asarray(tables.group)]
    away = local - fusion_barrier(local)[:, speaker]
    spoken = asked & (dot(away, away) < jnp.square(SURE * room[speaker]))
    to = jnp.where(spoken & at.known[speaker], speaker, len(speaker))
    rays = scattered(asked & ~spoken, jnp.array(True), to)
    return jnp.where(spoken, speaker, jnp.arange(len(speaker), dtype=jnp.int32)), rays


class _Wider(NamedTuple):
    """The carry of a search that goes farther and farther from the vertices that are `left`."""

    at: Contacts
    left: jax.Array  # [m] bool
    reach: jax.Array  # [] metres
    seen: jax.Array  # [c] bool, vertices of the surface whose outer side has been looked at
    free: jax.Array  # [c] bool, those of them with the winding number 0 there
    refused: jax.Array  # [r] bool, triangles with free corners that bounded nothing where it mattered
    begun: jax.Array  # [] bool: `at` holds the misled with the right side of their nearest sheets


def _bounding(
    at: Contacts,
    number: Int[Array, " m"],
    misled: Bool[Array, " m"],
    local: Float[Array, "3 m"],
    surface: PosedSurface,
    tables: CollisionTables,
):
    """Return the contacts, those `misled` with the nearest triangles that bound the union.

    A loop that goes round not once where nobody is: a condition would copy what it returns.
    """

    def wider(s: _Wider) -> _Wider:
        inside = number >= 1
        at, first = s.at, misled & ~s.begun
        nearest = _on_its_side(local, inside, Signed(at.point, at.direction, at.ds, at.direction))
        direction = jnp.where(first[None], nearest.direction, at.direction)
        begun = at._replace(ds=jnp.where(first, nearest.ds, at.ds), direction=direction)
        wanted = _corners_near(misled, s.reach, local, surface, tables) & ~s.seen
        free = _free_corners(s.free, wanted, surface, tables)
        # for a search: all but the triangles with free corners is nowhere
        bounds = free[jnp.asarray(tables.surface.faces)].all(axis=1) & ~s.refused
        corners = surface.corners.reshape(-1, 9, LEAF)
        corners = jnp.where(bounds.reshape(-1, 1, LEAF), corners, _NOWHERE)
        bounding = surface._replace(corners=corners.reshape(surface.corners.shape))

        def chunk(here: Array, to: Array, made: tuple) -> tuple:
            points, asked = local[:, here], to < len(misled)
            limit = jnp.where(asked, s.reach, -1.0)
            found = search_few(points, limit, bounding, tables)
            triangle = jnp.maximum(found, 0)
            sheet = signed_on(triangle, points, surface, tables.surface)
            beyond = sheet.point + BESIDE * sheet.normal
            around = winding_by_ray(beyond, sheet.normal[2] >= 0, found >= 0, surface, tables.surface)
            return _noted(made, to, found, around, _on_its_side(points, inside[here], sheet))

        at, left, refused = in_chunks(s.left, chunk, (begun, s.left, s.refused), RAYS)
        again = (refused != s.refused).any()  # what they hid may be as near
        reach = jnp.where(again, s.reach, 2 * s.reach)
        return _Wider(at, left, reach, s.seen | wanted, free, refused, jnp.array(True))

    nobody, none = jnp.zeros(len(tables.surface.corner_of), bool), jnp.zeros(len(tables.surface.faces), bool)
    start = _Wider(at, misled, jnp.asarray(REACH, local.dtype), nobody, nobody, none, jnp.array(False))
    return jax.lax.while_loop(lambda s: s.left.any() & (s.reach < WIDEST), wider, start).at


@noinline
def _corners_near(
    misled: Bool[Array, " m"],
    reach: Float[Array, ""],
    local: Float[Array, "3 m"],
    surface: PosedSurface,
    tables: CollisionTables,
) -> Bool[Array, " c"]:
    """Return the vertices of the leaves that come within `reach` of the box around those `misled`."""
    low = jnp.where(misled[None], local, jnp.inf).min(axis=1) - reach
    high = jnp.where(misled[None], local, -jnp.inf).max(axis=1) + reach
    bounds = surface.bounds.transpose(1, 0, 2).reshape(11, -1)
    middle, half = bounds[:3], bounds[3:6] + SLACK
    near = ((middle - half <= high[:, None]) & (middle + half >= low[:, None])).all(axis=0)
    corners = jnp.asarray(tables.surface.corners)
    marks = jnp.zeros(len(tables.surface.corner_of), jnp.int32)
    return marks.at[corners].max(near[:, None].astype(jnp.int32)) > 0


@noinline
def _free_corners(
    free: Bool[Array, " c"], wanted: Bool[Array, " c"], surface: PosedSurface, tables: CollisionTables
) -> Bool[Array, " c"]:
    """Return which vertices have the winding number 0 on their outer side, the `wanted` ones looked at."""

    def chunk(here: Array, to: Array, made: Array) -> Array:
        corner = surface.flat.reshape(3, -1)[:, here]
        on = signed_on(jnp.asarray(tables.surface.corner_of)[here], corner, surface, tables.surface)
        start = corner + BESIDE * on.normal
        around = winding_by_ray(start, on.normal[2] >= 0, to < len(wanted), surface, tables.surface)
        return made.at[to].set(around == 0, mode="drop")

    return in_chunks(wanted, chunk, free, RAYS)


@noinline
def _noted(
    made: tuple, to: Int[Array, " k"], found: Int[Array, " k"], around: Int[Array, " k"], sheet: Signed
) -> tuple:
    """Return contacts, what is left and what is refused with the answers of a chunk."""
    at, left, refused = made
    won = (found >= 0) & (around == 0)
    lost = jnp.where((found >= 0) & ~won & (to < len(left)), found, len(refused))
    to = jnp.where(won, to, len(left))
    return (
        at._replace(
            triangle=at.triangle.at[to].set(found, mode="drop"),
            ds=at.ds.at[to].set(sheet.ds, mode="drop"),
            point=at.point.at[:, to].set(sheet.point, mode="drop"),
            direction=at.direction.at[:, to].set(sheet.direction, mode="drop"),
        ),
        left.at[to].set(False, mode="drop"),
        refused.at[lost].set(True, mode="drop"),
    )


@noinline
def _on_its_side(points: Float[Array, "3 k"], inside: Bool[Array, " k"], at: Signed) -> Signed:
    """Return the same with the sign of the union's side; on the sheet as it was."""
    away = points - at.point
    distance = jnp.sqrt(jnp.maximum(dot(away, away), TOUCHING**2))
    far = distance > TOUCHING
    ds = jnp.where(inside, -distance, distance)
    direction = jnp.where(far[None], away / ds[None], at.direction)
    return at._replace(ds=jnp.where(far, ds, at.ds), direction=direction)
