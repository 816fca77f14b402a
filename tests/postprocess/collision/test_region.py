import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.geometry.laplacian import laplacian, uniform_table
from garment_jax.postprocess.collision import CollisionOptions
from garment_jax.postprocess.collision.contacts import Contacts
from garment_jax.postprocess.collision.descent import Iterate, first_places
from garment_jax.postprocess.collision.region import (
    dilate,
    find_members,
    make_region,
    region_sizes,
    smoothness,
    smoothness_gradient,
)
from tests.postprocess.collision.cloth import SIDE, sheet, tables


def _middle() -> np.ndarray:
    mask = np.zeros((SIDE, SIDE), bool)
    mask[10:13, 9:14] = True
    return mask.reshape(-1)


def test_dilation_adds_one_ring_at_a_time():
    made, *_ = tables()
    mask = _middle()
    grown = np.asarray(dilate(jnp.asarray(mask), made, 1))
    expected = mask.copy()
    for i in np.flatnonzero(mask):
        expected[made.index[i]] = True
    np.testing.assert_array_equal(grown, expected)
    np.testing.assert_array_equal(dilate(jnp.asarray(mask), made, 0), mask)


def test_sizes_of_regions_grow_with_the_garment():
    made, *_ = tables()  # 576 vertices, and one place for what stays put
    assert region_sizes(made, (0.15, 0.5)) == [96, 320, 608]
    assert region_sizes(made, (0.15, 0.151, 1.0)) == [96, 608]
    assert region_sizes(made, ()) == [608]
    for part in (0.0, 256, float("nan")):
        with pytest.raises(ValueError, match="parts of the garment"):
            region_sizes(made, (part, 0.5))


def test_a_regions_energy_and_gradient_are_the_whole_meshs():
    made, *_ = tables()
    moving = _middle()
    members = find_members(jnp.asarray(moving), made)
    region = make_region(members, made, 96)
    assert region.own.sum() == members.count == dilate(jnp.asarray(moving), made, 1).sum() < 96
    V, faces = sheet()
    x = np.where(moving[:, None], np.random.default_rng(0).normal(size=V.shape), 0).astype(np.float32)
    table = uniform_table(faces, len(V))
    value, gradient = jax.value_and_grad(lambda x: 0.5 * (laplacian(x, table) ** 2).sum())(jnp.asarray(x))
    local = jnp.where(region.own[:, None], jnp.asarray(x)[region.vertex], 0.0)
    here, slope = smoothness(local.T, region), smoothness_gradient(local.T, region)
    np.testing.assert_allclose(here, value, rtol=1e-5)
    at = np.flatnonzero(region.moving)
    assert len(at) == moving.sum()
    np.testing.assert_allclose(slope.T[at], gradient[region.vertex[at]], atol=1e-5)


def test_the_gradient_at_rest_is_zero_and_finite():
    made, *_ = tables()
    members = find_members(jnp.ones(SIDE * SIDE, bool), made)
    region = make_region(members, made, SIDE * SIDE)
    slope = smoothness_gradient(jnp.zeros((3, region.vertex.size)), region)
    np.testing.assert_array_equal(slope, 0.0)


def test_the_first_places_are_the_smaller_region():
    made, *_ = tables()
    members = find_members(jnp.asarray(_middle()), made)
    small, large = make_region(members, made, 96), make_region(members, made, 320)
    nowhere, number = jnp.zeros((3, 320)), jnp.zeros(320)
    at = Contacts(number.astype(jnp.int32), number, number > 0, nowhere, nowhere)
    now = Iterate(nowhere, nowhere, jnp.ones(()))
    cut, *_ = first_places(96, now, nowhere, at, large, CollisionOptions())
    for name, leaf, expected in zip(small._fields, cut, small, strict=True):
        np.testing.assert_array_equal(leaf, expected, err_msg=name)
