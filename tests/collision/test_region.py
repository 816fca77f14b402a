import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.collision.region import dilate, make_region, smoothness
from garment_jax.geometry.laplacian import laplacian, uniform_table
from tests.collision.cloth import SIDE, sheet, tables


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


def test_a_regions_energy_and_gradient_are_the_whole_meshs():
    made, *_ = tables()
    moving = _middle()
    touched = dilate(jnp.asarray(moving), made, 1)
    region = make_region(touched, jnp.asarray(moving), made, 96)
    assert region.own.sum() == touched.sum() < 96
    V, faces = sheet()
    x = np.where(moving[:, None], np.random.default_rng(0).normal(size=V.shape), 0).astype(np.float32)
    table = uniform_table(faces, len(V))
    value, gradient = jax.value_and_grad(lambda x: 0.5 * (laplacian(x, table) ** 2).sum())(jnp.asarray(x))
    local = jnp.where(region.own[:, None], jnp.asarray(x)[region.vertex], 0.0)
    here, slope = jax.value_and_grad(smoothness)(local, region)
    np.testing.assert_allclose(here, value, rtol=1e-5)
    at = np.flatnonzero(region.moving)
    assert len(at) == moving.sum()
    np.testing.assert_allclose(slope[at], gradient[region.vertex[at]], atol=1e-5)


def test_the_gradient_at_rest_is_zero_and_finite():
    made, *_ = tables()
    everything = jnp.ones(SIDE * SIDE, bool)
    region = make_region(everything, everything, made, SIDE * SIDE)
    slope = jax.grad(smoothness)(jnp.zeros((region.vertex.size, 3)), region)
    np.testing.assert_array_equal(slope, 0.0)
