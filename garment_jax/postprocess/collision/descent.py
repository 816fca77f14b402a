"""The steps of section 3.5: along the gradient of the smooth part, then onto the planes of the contacts.

Steps run on the first places of a region that hold all that moves, in one of a few sizes: the cost follows
the contacts, and only the steps, not the searches between them, are compiled once a size.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.geometry.elastic import GOLDEN, accelerated
from garment_jax.geometry.noinline import noinline
from garment_jax.geometry.triangle import dot
from garment_jax.postprocess.collision.contacts import Contacts
from garment_jax.postprocess.collision.options import CollisionOptions
from garment_jax.postprocess.collision.region import Region, smoothness_gradient
from garment_jax.postprocess.collision.tables import CollisionTables


class Iterate(NamedTuple):
    """Where an accelerated descent stands, on the `m` places of a region."""

    x: jax.Array  # [3, m] displacement from V_f, metres; 0 where nothing moves
    y: jax.Array  # [3, m] the same, extrapolated
    theta: jax.Array  # [] Nesterov's sequence


def advance(
    descend: Array,
    now: Iterate,
    local: Float[Array, "3 m"],
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

    `local`: V_f, relative to the surface's origin, metres; `at`: contacts, known only where something moves;
    `sizes`: of first places, the region's own last; `count`: places with a member.
    The steps keep `options.eps`, the projection `margin` (metres).
    """
    fits = sum((count >= size).astype(jnp.int32) for size in sizes[:-1])

    steps = [lambda size=size: _descend(size, now, local, at, region, tables, options) for size in sizes]
    return jax.lax.switch(
        jnp.where(descend, 1 + fits, 0), [lambda: now._replace(x=_pushed(local, now.x, at, margin)), *steps]
    )


def _descend(
    size: int,
    now: Iterate,
    local: Float[Array, "3 m"],
    at: Contacts,
    region: Region,
    tables: CollisionTables,
    options: CollisionOptions,
) -> Iterate:
    """Take the steps on the first `size` places, with the coordinates first: so they vectorise."""
    part, x, y, direction, height = first_places(size, now, local, at, region, options)

    def step(_: int | Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        x, y, theta = carry
        ahead = _ahead(y, part, tables)
        short = jnp.maximum(height - dot(ahead, direction), 0.0)
        new = ahead + jnp.where(part.moving, short, 0.0)[None] * direction
        return new, *accelerated(new, x, y, theta, restart=GOLDEN)  # twenty steps are all there are

    x, y, theta = jax.lax.fori_loop(0, options.refresh_every, step, (x, y, now.theta))
    return Iterate(now.x.at[:, :size].set(x), now.y.at[:, :size].set(y), theta)


@noinline
def first_places(
    size: int,
    now: Iterate,
    local: Float[Array, "3 m"],
    at: Contacts,
    region: Region,
    options: CollisionOptions,
) -> tuple[Region, *tuple[Array, ...]]:
    """Return the region of the first `size` places, more than its members, and what is there.

    That is the iterate, and the planes of the contacts: direction . x >= height.
    """
    part = Region(*(leaf[..., :size] for leaf in region))
    part = part._replace(index=jnp.minimum(part.index, size - 1))
    x, y, local, point, direction = (leaf[:, :size] for leaf in (now.x, now.y, local, at.point, at.direction))
    direction = jnp.where(at.known[None, :size], direction, 0.0)  # without a correspondence there is no plane
    return part, x, y, direction, options.eps - dot(local - point, direction)


@noinline
def _ahead(y: Float[Array, "3 m"], region: Region, tables: CollisionTables) -> Float[Array, "3 m"]:
    """Return `y` after a gradient step on the smooth part, 0 where nothing moves (metres)."""
    ahead = y - smoothness_gradient(y, region) / jnp.asarray(tables.lipschitz, y.dtype)
    return jnp.where(region.moving[None], ahead, 0.0)


@noinline
def _pushed(
    local: Float[Array, "3 m"], x: Float[Array, "3 m"], at: Contacts, margin: Array
) -> Float[Array, "3 m"]:
    """Return the displacement after projection; where there is no correspondence, as it was."""
    height = jnp.maximum(margin - dot(local + x - at.point, at.direction), 0.0)
    return x + jnp.where(at.known, height, 0.0)[None] * at.direction
