from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.geometry.gather import coordinates_of
from garment_jax.geometry.laplacian import laplacian, uniform_table
from garment_jax.geometry.surface_search import pose_surface
from garment_jax.postprocess.collision import CollisionOptions, initial_state
from garment_jax.postprocess.collision.contacts import find_contacts
from garment_jax.postprocess.collision.loop import SMALL, iterate
from garment_jax.postprocess.collision.region import dilate, find_members, region_sizes
from tests.geometry.surfaces import brute_signed
from tests.postprocess.collision.cloth import SIDE, sheet, tables

EPS, RINGS = 2e-3, 1
HOLDS = 0.15  # of the garment: the smaller loop's region


@partial(jax.jit, static_argnames="sizes")
def looped(V, body, triangle, sizes: tuple[float, ...]):
    made = tables()[0]
    surface = pose_surface(body, made.surface)
    local = V.T - surface.origin[:, None]
    everywhere = jnp.full(len(V), jnp.inf)
    first = find_contacts(
        local, coordinates_of(made.groups.T, local.reshape(-1)), triangle, everywhere, surface, made
    )
    members = find_members(dilate(first.known & (first.ds < EPS), made, RINGS), made)
    x = jnp.zeros_like(local)
    options = CollisionOptions(eps=EPS, sizes=sizes)
    return iterate(local, x, first, members, surface, made, options), first, members


def at_height(height: float, sizes: tuple[float, ...]):
    """Return what `looped` does for a sheet at this height (metres) over the bumpy surface."""
    made, body, _ = tables()
    V, _ = sheet(height)
    triangle = initial_state(jnp.asarray(V), jnp.asarray(body), made.surface).triangle
    return V, *looped(jnp.asarray(V), jnp.asarray(body), triangle, sizes)


# metres: a few vertices inside, as many as the smaller region holds; and more than that
@pytest.mark.parametrize(("height", "small"), [(0.235, True), (0.16, False)])
def test_what_moves_ends_outside_and_its_contacts_are_the_bodys(height: float, small: bool):
    V, end, first, members = at_height(height, (HOLDS,))
    made, body, faces = tables()
    assert region_sizes(made, (HOLDS,))[0] <= SMALL * region_sizes(made, ())[0]
    assert (members.count < region_sizes(made, (HOLDS,))[0]) == small
    moving, moved = np.asarray(members.moving), V + np.asarray(end.x).T
    ds = brute_signed(moved, body, faces)
    assert (brute_signed(V, body, faces)[moving] < 0).sum() > 3
    assert end.steps > 0
    assert ds[moving].min() > 0
    found = np.asarray(end.at.ds)
    near = np.asarray(end.at.known) & moving & (found < EPS)
    assert near.any()
    np.testing.assert_allclose(found[near], ds[near], atol=1e-5)
    assert (found[moving] <= ds[moving] + 1e-5).all()  # elsewhere a bound, less what was moved since
    np.testing.assert_array_equal(end.x[:, ~moving], 0.0)
    for last, now in zip(first, end.at, strict=True):  # bitwise what they were
        np.testing.assert_array_equal(now[..., ~moving], last[..., ~moving])
    energy = laplacian(jnp.asarray(moved - V), uniform_table(sheet()[1], SIDE * SIDE))
    assert end.objective == pytest.approx(np.linalg.norm(energy), rel=1e-3)


def test_the_loops_size_does_not_change_what_it_finds():
    _, small, *_ = at_height(0.235, (HOLDS,))
    _, whole, *_ = at_height(0.235, ())
    np.testing.assert_allclose(small.x, whole.x, atol=1e-5)
    np.testing.assert_array_equal(small.at.known, whole.at.known)
    assert small.steps == whole.steps
