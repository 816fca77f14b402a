import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.model.generative.convolution import down_convolution, up_convolution
from tests.reference import convolution as slow

LAYOUT = ("NHWC", "HWIO", "NHWC")
MAP = (2, 8, 6, 3)  # batch, h, w, c: no two alike


def arrays(*shapes: tuple[int, ...]) -> list[jax.Array]:
    rng = np.random.default_rng(0)
    return [jnp.asarray(rng.normal(size=shape), jnp.float32) for shape in shapes]


def native_down(x: jax.Array, kernel: jax.Array) -> jax.Array:
    return jax.lax.conv_general_dilated(x, kernel, (2, 2), ((1, 1), (1, 1)), dimension_numbers=LAYOUT)


def native_up(x: jax.Array, phases: jax.Array) -> jax.Array:
    """The transposed convolution as XLA has it: zeros between the texels, the kernel turned round."""
    kernel = slow.four_by_four(phases)[::-1, ::-1]
    return jax.lax.conv_general_dilated(
        x, kernel, (1, 1), ((2, 2), (2, 2)), lhs_dilation=(2, 2), dimension_numbers=LAYOUT
    )


CASES = {
    "down": (down_convolution, native_down, (4, 4, 3, 5)),
    "up": (up_convolution, native_up, (2, 2, 3, 20)),
}


def test_down_is_the_loop_over_texels_and_taps():
    x, kernel = arrays(MAP, (4, 4, 3, 5))
    y = down_convolution(x, kernel)
    assert y.shape == (2, 4, 3, 5)
    for k in range(2):
        np.testing.assert_allclose(y[k], slow.down(np.asarray(x[k]), np.asarray(kernel)), atol=1e-5)


def test_up_is_the_scatter_of_every_texels_taps():
    x, phases = arrays(MAP, (2, 2, 3, 20))
    y = up_convolution(x, phases)
    assert y.shape == (2, 16, 12, 5)
    kernel = slow.four_by_four(np.asarray(phases))
    for k in range(2):
        np.testing.assert_allclose(y[k], slow.up(np.asarray(x[k]), kernel), atol=1e-5)


@pytest.mark.parametrize("name", CASES)
def test_values_and_both_gradients_are_those_of_native_autodiff(name):
    function, native, shape = CASES[name]
    x, kernel = arrays(MAP, shape)
    expected, native_pull = jax.vjp(jax.jit(native), x, kernel)
    y, pull = jax.vjp(jax.jit(function), x, kernel)
    np.testing.assert_allclose(y, expected, atol=2e-5)
    (g,) = arrays(y.shape)
    for found, truth in zip(pull(g), native_pull(g), strict=True):
        assert found.shape == truth.shape
        np.testing.assert_allclose(found, truth, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("batch", [(), (2, 3)])
def test_leading_axes_are_batch_axes_and_share_one_weight_gradient(name, batch):
    function, _, shape = CASES[name]
    x, kernel = arrays((*batch, 4, 4, 3), shape)
    flat = x.reshape(-1, 4, 4, 3)

    def loss(function, kernel, x):
        return jnp.square(function(x, kernel)).sum()

    whole = jax.jit(jax.grad(lambda k: loss(function, k, x)))(kernel)
    parts = jax.jit(jax.grad(lambda k: sum((loss(function, k, part) for part in flat), jnp.zeros(()))))(
        kernel
    )
    np.testing.assert_allclose(whole, parts, rtol=1e-4, atol=1e-4)
    assert function(x, kernel).shape[: len(batch)] == batch
