"""A frame's loop (section 3.5): steps, a search, steps, a search, then pushed out until nothing is inside.

It runs on the vertices that may move, gathered once a frame into arrays of one of two sizes: what a search
marks and what a projection moves costs what the contacts cost, not what the garment does.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from garment_jax.geometry.gather import gathered, scattered
from garment_jax.geometry.noinline import noinline
from garment_jax.geometry.surface_search import PosedSurface
from garment_jax.geometry.triangle import squared_length
from garment_jax.postprocess.collision.contacts import Contacts, find_again
from garment_jax.postprocess.collision.descent import Iterate, advance
from garment_jax.postprocess.collision.options import CollisionOptions
from garment_jax.postprocess.collision.region import Members, make_region, region_sizes, smoothness
from garment_jax.postprocess.collision.tables import CollisionTables

FAR = 5e-3  # metres after which a bound from before is not trusted
SMALL = 0.2  # of the garment at most that the smaller of the two sizes holds


class End(NamedTuple):
    """Where a frame's loop ended, for the whole garment."""

    x: jax.Array  # [3, n] displacement from V_f, metres
    at: Contacts  # of V_f moved by `x`
    steps: jax.Array  # [] int32 gradient steps taken
    moved: jax.Array  # [] metres, between the last two searches of the descent
    objective: jax.Array  # [] ||Lap x||, metres


class _Progress(NamedTuple):
    """The carry of the loop, of the `m` places of a region."""

    now: Iterate
    at: Contacts  # correspondences of the displacement `searched`
    searched: jax.Array  # [3, m]
    steps: jax.Array  # as in `End`
    moved: jax.Array
    pushes: jax.Array  # [] int32 projections since the descent ended


def iterate(
    local: Float[Array, "3 n"],
    x: Float[Array, "3 n"],
    first: Contacts,
    members: Members,
    surface: PosedSurface,
    tables: CollisionTables,
    options: CollisionOptions,
) -> End:
    """Return the end of a frame's loop, begun from the displacement `x`, for a frame with members.

    `local`: V_f with its pins, relative to the surface's origin, metres, whose contacts are `first`.
    """
    sizes = region_sizes(tables, options.sizes)
    few = sum(size <= SMALL * sizes[-1] for size in sizes)
    loops = [part for part in (sizes[:few], sizes[few:]) if part]

    solved = [partial(_in_region, part, local, x, first, members, surface, tables, options) for part in loops]
    wanted = sum(((members.count >= part[-1]).astype(jnp.int32) for part in loops[:-1]), jnp.int32(0))
    return jax.lax.switch(wanted, solved)


def _in_region(
    sizes: list[int],
    local: Float[Array, "3 n"],
    x: Float[Array, "3 n"],
    first: Contacts,
    members: Members,
    surface: PosedSurface,
    tables: CollisionTables,
    options: CollisionOptions,
) -> End:
    """Return the end of the loop on a region, whose steps take one of `sizes` of its first places."""
    region = make_region(members, tables, sizes[-1])
    v, moving = region.vertex, region.moving
    part, start, at = gathered((local, x, first), v)
    # only of what moves anything is known, and any displacement
    start, at = jnp.where(moving[None], start, 0.0), at._replace(known=moving & at.known)
    margin = options.eps * (1 - options.slack)

    def goes_on(s: _Progress) -> tuple[Array, Array]:
        """Return whether the descent does, and whether something is to be projected after it."""
        descends = (s.steps < options.iterations) & (s.moved > options.tolerance)
        lowest = jnp.where(s.at.known, s.at.ds, jnp.inf).min()
        # what half of the projections left nearer than the margin, but outside, has no room for it
        wanted = jnp.where(s.pushes < (options.projections + 1) // 2, margin, 0.0)
        return descends, (lowest < wanted) & (s.pushes < options.projections)

    def body(s: _Progress) -> _Progress:
        on, _ = goes_on(s)
        # in the second half of the projections half of the last one's each time. That half is for what is
        # inside: pushed out of one wall by the whole margin, a vertex in a narrower gap is inside the other,
        # and so on; nearer to the wall there is room for it
        margin = options.eps * 0.5 ** jnp.maximum(s.pushes - options.projections // 2 + 1, 0)
        now = advance(on, s.now, part, s.at, region, sizes, members.count, tables, options, margin=margin)
        points, ds, limit, moved = _next_limit(now.x, s.now.x, s.searched, part, s.at, moving, options)
        at = find_again(points, s.at._replace(ds=ds), limit, surface, tables)
        steps, pushes = s.steps + jnp.where(on, options.refresh_every, 0), s.pushes + jnp.where(on, 0, 1)
        return _Progress(now, at, now.x, steps, jnp.where(on, moved, s.moved), pushes)

    none, one = jnp.int32(0), jnp.ones((), x.dtype)
    begin = _Progress(Iterate(start, start, one), at, jnp.zeros_like(start), none, jnp.inf * one, none)
    end = jax.lax.while_loop(lambda s: jnp.logical_or(*goes_on(s)), body, begin)
    to = jnp.where(moving, v, x.shape[1])  # of the garment; the others are as they were
    x, at = scattered((x, first), (end.now.x, end.at), to)
    return End(x, at, end.steps, end.moved, jnp.sqrt(2 * smoothness(end.now.x, region)))


@noinline
def _next_limit(
    x: Float[Array, "3 m"],
    last: Float[Array, "3 m"],
    searched: Float[Array, "3 m"],
    local: Float[Array, "3 m"],
    at: Contacts,
    moving: Bool[Array, " m"],
    options: CollisionOptions,
) -> tuple[Array, ...]:
    """Return the vertices moved by `x`, their distances or bounds, how far to search around them, and how far
    the farthest has moved since the `last` displacement.

    Only those are asked that may have come within the margin; the others' distance shrinks by what
    they have moved, which keeps it a lower bound. Where parts of the body cross each other, that bound
    may rest on the wrong sign: after a long way it is not trusted.
    """
    shift = jnp.sqrt(squared_length(x - searched))
    points, ds, far = local + x, at.ds - shift, shift > FAR
    asked = moving & (far | (ds < options.eps))
    away = points - at.point  # the point is still on the surface: none is farther
    bound = jnp.sqrt(squared_length(away)) * (1 + 1e-4) + 1e-6
    limit = jnp.where(far, jnp.inf, jnp.maximum(shift, options.eps))
    limit = jnp.where(asked, jnp.where(at.known, bound, limit), -1.0)
    return points, ds, limit, jnp.sqrt(squared_length(x - last).max())
