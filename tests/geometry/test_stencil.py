import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.geometry.stencil import apply_stencil, dense_matrix, make_stencil

ROWS, COLUMNS, TAPS = 7, 5, 3


def operator(seed: int = 0):
    """A stencil with repeated and absent columns and padding, and its dense matrix."""
    rng = np.random.default_rng(seed)
    index = rng.integers(0, COLUMNS - 1, (ROWS, TAPS))  # nobody reads the last column
    weight = rng.normal(size=(ROWS, TAPS)) * (rng.random((ROWS, TAPS)) < 0.7)
    dense = np.zeros((ROWS, COLUMNS))
    for i in range(ROWS):
        for k in range(TAPS):
            dense[i, index[i, k]] += weight[i, k]
    return make_stencil(index, weight, COLUMNS), dense


@pytest.mark.parametrize("batch", [(), (2,), (2, 3)])
def test_forward_is_the_dense_matrix_and_the_gradient_its_transpose(batch):
    stencil, dense = operator()
    rng = np.random.default_rng(1)
    x = jnp.asarray(rng.normal(size=(*batch, COLUMNS, 3)), jnp.float32)
    g = jnp.asarray(rng.normal(size=(*batch, ROWS, 3)), jnp.float32)
    y, pull = jax.vjp(lambda x: apply_stencil(x, stencil), x)
    np.testing.assert_allclose(y, dense @ np.asarray(x), atol=1e-6)
    np.testing.assert_allclose(pull(g)[0], dense.T @ np.asarray(g), atol=1e-6)


def test_the_matrix_is_the_dense_one():
    stencil, dense = operator()
    np.testing.assert_allclose(dense_matrix(stencil, COLUMNS), dense, atol=1e-6)


def test_the_stored_transpose_is_the_transpose():
    stencil, dense = operator()
    transpose = np.zeros((COLUMNS, ROWS))
    for i in range(COLUMNS):
        np.add.at(transpose[i], stencil.index_t[i], stencil.weight_t[i])
    np.testing.assert_allclose(transpose, dense.T, atol=1e-7)


def test_under_jit_vmap_and_scan_it_is_the_same():
    stencil, dense = operator()
    x = jnp.asarray(np.random.default_rng(2).normal(size=(4, COLUMNS, 3)), jnp.float32)
    expected = dense @ np.asarray(x)
    np.testing.assert_allclose(jax.jit(jax.vmap(lambda x: apply_stencil(x, stencil)))(x), expected, atol=1e-6)
    _, scanned = jax.lax.scan(lambda c, x: (c, apply_stencil(x, stencil)), 0, x)
    np.testing.assert_allclose(scanned, expected, atol=1e-6)


def test_a_nan_reaches_the_rows_that_read_it_and_no_other():
    stencil, dense = operator()
    x = jnp.ones((COLUMNS, 3)).at[0, 0].set(jnp.nan)
    y = np.asarray(jax.jit(lambda x: apply_stencil(2 * x, stencil))(x))
    assert np.isnan(y[dense[:, 0] != 0, 0]).all()
    np.testing.assert_allclose(y[:, 1], 2 * dense.sum(axis=1), atol=1e-6)


def test_an_operator_of_zeros_gives_zeros():
    stencil = make_stencil(np.zeros((2, 3), int), np.zeros((2, 3)), 4)
    x = jnp.ones((4, 1))
    np.testing.assert_array_equal(apply_stencil(x, stencil), 0)
    np.testing.assert_array_equal(jax.grad(lambda x: apply_stencil(x, stencil).sum())(x), 0)
