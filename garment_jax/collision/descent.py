"""The steps of section 3.5: along the gradient of the smooth part, then onto the planes of the contacts.

Steps run on the vertices around the contacts, gathered into arrays of one of a few sizes: the cost follows
the contacts, and only the steps, not the searches between them, are compiled once a size.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from garment_jax.collision.contacts import Contacts
from garment_jax.collision.region import Members, Region, make_region, region_sizes, smoothness
from garment_jax.collision.tables import CollisionTables
from garment_jax.geometry.apart import apart
from garment_jax.geometry.triangle import dot


class Iterate(NamedTuple):
    """Where an accelerated descent stands."""

    x: jax.Array  # [3, n] displacement from V_f, metres
    y: jax.Array  # [3, n] the same, extrapolated
    theta: jax.Array  # [] Nesterov's sequence


def advance(
    descend: Array,
    now: Iterate,
    local: Float[Array, "3 n"],
    at: Contacts,
    members: Members,
    tables: CollisionTables,
    options,
    *,
    margin: Array,
) -> Iterate:
    """Return the iterate projected (`descend` is False), or after `options.refresh_every` steps.

    The steps keep `options.eps`, the projection `margin` (metres).
    """
    sizes = region_sizes(tables, options.sizes)
    fits = sum((members.count >= size).astype(jnp.int32) for size in sizes[:-1])

    def projected() -> Iterate:
        return now._replace(x=_pushed(local, now.x, at, members.moving, margin))

    steps = [lambda size=size: _descend(size, now, local, at, members, tables, options) for size in sizes]
    return jax.lax.switch(jnp.where(descend, 1 + fits, 0), [projected, *steps])


def _descend(size, now: Iterate, local, at: Contacts, members, tables, options) -> Iterate:
    """Take the steps on a region of `size` places, with the coordinates first: so they vectorise."""
    region = make_region(members, tables, size)
    x, y, direction, height = _taken(now, local, at, region, options.eps)
    step = partial(_gradient_step, direction, height, region, tables)
    x, y, theta = jax.lax.fori_loop(0, options.refresh_every, step, (x, y, now.theta))
    return Iterate(*_put_back(now, x, y, region), theta)


@apart
def _taken(now: Iterate, local, at: Contacts, region: Region, eps) -> tuple[Array, Array, Array, Array]:
    """Return the iterate of a region's vertices and their planes: direction . x >= height."""
    x, y, base, point, direction = (
        leaf[:, region.vertex] for leaf in (now.x, now.y, local, at.point, at.direction)
    )
    x, y = (jnp.where(region.moving[None], z, 0.0) for z in (x, y))
    # where there is no correspondence, there is no plane
    direction = jnp.where((region.moving & at.known[region.vertex])[None], direction, 0.0)
    return x, y, direction, eps - dot(base - point, direction)


@apart
def _put_back(now: Iterate, x, y, region: Region) -> tuple[Array, Array]:
    target = jnp.where(region.moving, region.vertex, now.x.shape[1])
    x, y = (whole.at[:, target].set(z, mode="drop") for whole, z in ((now.x, x), (now.y, y)))
    return x, y


def _gradient_step(direction, height, region: Region, tables, _, carry):
    """Take one step of Nesterov's method along `jax.grad` of the smooth part, then project."""
    x, y, theta = carry
    return _onto_planes(_ahead(y, region, tables), x, y, theta, direction, height, region.moving)


@apart
def _ahead(y: Float[Array, "3 m"], region: Region, tables) -> Float[Array, "3 m"]:
    ahead = y - jax.grad(smoothness)(y, region) / jnp.asarray(tables.lipschitz, y.dtype)
    return jnp.where(region.moving[None], ahead, 0.0)


@apart
def _onto_planes(ahead: Float[Array, "3 m"], x, y, theta, direction, height, moving):
    """Return the next iterate `ahead` projected, the one extrapolated from it, and theta.

    The constraint of a displacement: direction . x >= height. Restart (O'Donoghue and Candes 2015):
    momentum that points uphill is thrown away.
    """
    short = jnp.maximum(height - dot(ahead, direction), 0.0)
    new = ahead + jnp.where(moving, short, 0.0)[None] * direction
    uphill = jnp.vdot(y - new, new - x) > 0
    theta = jnp.where(uphill, 1.0, theta)
    following = (1 + jnp.sqrt(1 + 4 * theta**2)) / 2
    beta = jnp.where(uphill, 0.0, (theta - 1) / following)
    return new, new + beta * (new - x), following


@apart
def _pushed(local, x, at: Contacts, moving: Array, margin: Array):
    """Return the displacement after projection; where there is no correspondence, as it was."""
    height = jnp.maximum(margin - dot(local + x - at.point, at.direction), 0.0)
    return x + jnp.where(moving & at.known, height, 0.0)[None] * at.direction
