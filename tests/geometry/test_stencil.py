import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.geometry.stencil import apply_stencil, dense_matrix, make_stencil, materialised

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


@pytest.mark.parametrize("first", [1.5, -0.0, np.nan, np.inf])
def test_what_is_materialised_keeps_every_bit(first):
    x = np.array([first, -0.0, 1e-40, -np.inf, np.nan, 3.0], np.float32)
    found = np.asarray(jax.jit(materialised)(jnp.asarray(x)))
    np.testing.assert_array_equal(found.view(np.int32) | np.isnan(x), x.view(np.int32) | np.isnan(x))


@pytest.mark.parametrize("first", [7, -8, np.iinfo(np.int32).min, np.iinfo(np.int32).max])
def test_so_do_integers_and_what_comes_beside_them(first):
    x = np.array([first, 0, -1, np.iinfo(np.int32).min, 5], np.int32)
    y = np.array([[np.nan, 2.0]], np.float32)
    found = jax.jit(materialised)((jnp.asarray(x), {"y": jnp.asarray(y)}))
    np.testing.assert_array_equal(found[0], x)
    np.testing.assert_array_equal(found[1]["y"], y)


def test_what_is_empty_comes_back():
    empty, one = jnp.zeros((0, 3)), jnp.ones(2)
    assert materialised(empty).shape == (0, 3)
    found = materialised((empty, one))
    assert found[0].shape == (0, 3)
    np.testing.assert_array_equal(found[1], one)


def test_the_gradient_of_what_is_materialised():
    x = jnp.asarray([0.3, -2.0], jnp.float32)
    for start in (0.0, np.nan):
        loss = lambda x: (materialised(jnp.concatenate([jnp.array([start]), 3 * x**2]))[1:]).sum()  # noqa: B023, E731
        np.testing.assert_allclose(jax.jit(jax.grad(loss))(x), 6 * x)


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="a CPU's fusions")
def test_on_a_cpu_the_branch_is_still_there_when_compiled():
    for x in (jnp.ones((3, 200)), jnp.ones(64, jnp.int32)):
        text = jax.jit(lambda x: materialised(x + x) * 2).lower(x).compile().as_text()
        assert "conditional(" in text
