"""The steps of section 3.5: along the gradient of the smooth part, then onto the planes of the contacts.

Steps run on the first places of a region that hold all that moves, in one of a few sizes: the cost follows
the contacts, and only the steps, not the searches between them, are compiled once a size.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from garment_jax.geometry.noinline import noinline
from garment_jax.geometry.triangle import dot
from garment_jax.postprocess.collision.contacts import Contacts
from garment_jax.postprocess.collision.options import CollisionOptions
from garment_jax.postprocess.collision.region import Region, first_places, smoothness
from garment_jax.postprocess.collision.tables import CollisionTables


class Iterate(NamedTuple):
    """Where an accelerated descent stands, on the `m` places of a region."""

    x: jax.Array  # [3, m] displacement from V_f, metres; 0 where nothing moves
    y: jax.Array  # [3, m] the same, extrapolated
    theta: jax.Array  # [] Nesterov's sequence


def advance(
    descend: Array,
    now: Iterate,
    base: Float[Array, "3 m"],
    at: Contacts,
    region: Region,
    sizes: list[int],
    count: Array,
    tables: CollisionTables,
    options: CollisionOptions,
    *,
    margin: Array,
) -> Iterate:
    """Return the iterate projected (`descend` is False), or after `options.refresh_every` steps.

    `base`: V_f, metres; `at`: contacts, known only where something moves; `sizes`: of first places, the
    region's own last; `count`: places with a member.
    The steps keep `options.eps`, the projection `margin` (metres).
    """
    fits = sum((count >= size).astype(jnp.int32) for size in sizes[:-1])

    steps = [lambda size=size: _descend(size, now, base, at, region, tables, options) for size in sizes]
    return jax.lax.switch(
        jnp.where(descend, 1 + fits, 0), [lambda: now._replace(x=_pushed(base, now.x, at, margin)), *steps]
    )


def _descend(
    size: int,
    now: Iterate,
    base: Float[Array, "3 m"],
    at: Contacts,
    region: Region,
    tables: CollisionTables,
    options: CollisionOptions,
) -> Iterate:
    """Take the steps on the first `size` places, with the coordinates first: so they vectorise."""
    part, x, y, direction, height = _taken(size, now, base, at, region, options.eps)

    def step(_: int | Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        return _onto_planes(_ahead(carry[1], part, tables), *carry, direction, height, part.moving)

    x, y, theta = jax.lax.fori_loop(0, options.refresh_every, step, (x, y, now.theta))
    return Iterate(now.x.at[:, :size].set(x), now.y.at[:, :size].set(y), theta)


@noinline
def _taken(
    size: int, now: Iterate, base: Float[Array, "3 m"], at: Contacts, region: Region, eps: float | Array
) -> tuple[Region, *tuple[Array, ...]]:
    """Return a region's first places, the iterate there and the planes: direction . x >= height."""
    x, y, base, point, direction = (leaf[:, :size] for leaf in (now.x, now.y, base, at.point, at.direction))
    direction = jnp.where(at.known[None, :size], direction, 0.0)  # without a correspondence there is no plane
    return first_places(region, size), x, y, direction, eps - dot(base - point, direction)


@noinline
def _ahead(y: Float[Array, "3 m"], region: Region, tables: CollisionTables) -> Float[Array, "3 m"]:
    ahead = y - jax.grad(smoothness)(y, region) / jnp.asarray(tables.lipschitz, y.dtype)
    return jnp.where(region.moving[None], ahead, 0.0)


@noinline
def _onto_planes(
    ahead: Float[Array, "3 m"],
    x: Float[Array, "3 m"],
    y: Float[Array, "3 m"],
    theta: Float[Array, ""],
    direction: Float[Array, "3 m"],
    height: Float[Array, " m"],
    moving: Bool[Array, " m"],
):
    """Return the next iterate `ahead` projected, the one extrapolated from it, and theta (Nesterov).

    The constraint of a displacement: direction . x >= height. Restart (O'Donoghue and Candes 2015):
    momentum that points uphill is thrown away.
    """
    short = jnp.maximum(height - dot(ahead, direction), 0.0)
    new = ahead + jnp.where(moving, short, 0.0)[None] * direction
    uphill = dot(y - new, new - x).sum() > 0  # `vdot` takes six times as long
    theta = jnp.where(uphill, 1.0, theta)
    following = (1 + jnp.sqrt(1 + 4 * theta**2)) / 2
    beta = jnp.where(uphill, 0.0, (theta - 1) / following)
    return new, new + beta * (new - x), following


@noinline
def _pushed(base: Float[Array, "3 m"], x: Float[Array, "3 m"], at: Contacts, margin: Array):
    """Return the displacement after projection; where there is no correspondence, as it was."""
    height = jnp.maximum(margin - dot(base + x - at.point, at.direction), 0.0)
    return x + jnp.where(at.known, height, 0.0)[None] * at.direction
