import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.model.generative.blocks import InstanceNorm, MapDecoder, MapEncoder, flatten, leaky, pool
from tests.reference.small_model import fast_key


def maps(*shape: int) -> jax.Array:
    return jnp.asarray(np.random.default_rng(0).normal(2, 3, shape), jnp.float32)


def test_instance_norm_is_the_numpy_one_with_pytorchs_epsilon():
    x = maps(2, 4, 6, 3)
    params = {"scale": jnp.array([1.0, 2, 3]), "bias": jnp.array([0.0, -1, 1])}
    y = jax.jit(InstanceNorm().apply)({"params": params}, x)
    for k in range(2):
        for c in range(3):
            channel = np.asarray(x[k, :, :, c], np.float64)
            normal = (channel - channel.mean()) / np.sqrt(channel.var() + 1e-5)
            np.testing.assert_allclose(y[k, :, :, c], normal * (c + 1) + params["bias"][c], atol=1e-5)


def test_a_constant_map_becomes_the_bias_with_a_finite_gradient():
    params = {"params": {"scale": jnp.array([3.0, 4]), "bias": jnp.array([0.5, -2])}}
    norm = jax.jit(lambda x: InstanceNorm().apply(params, x))
    x = jnp.full((4, 4, 2), 7.0)
    np.testing.assert_allclose(norm(x)[1, 2], [0.5, -2], atol=1e-3)
    assert np.isfinite(jax.jit(jax.grad(lambda x: norm(x)[0, 0, 0]))(x)).all()


def test_pool_takes_block_means_and_flatten_keeps_batch_axes():
    x = maps(2, 3, 8, 8, 3)
    pooled = pool(x, 4)
    assert pooled.shape == (2, 3, 4, 4, 3)
    np.testing.assert_allclose(pooled[1, 2, 3, 0], np.asarray(x)[1, 2, 6:8, 0:2].mean(axis=(0, 1)), rtol=1e-5)
    np.testing.assert_array_equal(pool(x, 8), x)
    assert flatten(x).shape == (2, 3, 192)
    np.testing.assert_allclose(leaky(jnp.array([-1.0, 2.0])), [-0.2, 2.0])


@pytest.mark.parametrize("skip", [0, 4])
@pytest.mark.parametrize("batch", [(), (3,)])
def test_encoder_and_decoder_shapes(skip, batch):
    S = jax.ShapeDtypeStruct((*batch, 8, 8, 3), jnp.float32)
    encoder = MapEncoder((2, 3), 5, skip=skip, skip_hidden=skip)
    z, _ = jax.eval_shape(encoder.init_with_output, jax.random.key(0), S)
    assert z.shape == (*batch, 5)
    decoder = MapDecoder((2, 3), 8, skip=bool(skip))
    out, _ = jax.eval_shape(decoder.init_with_output, jax.random.key(0), z)
    assert out.shape == (*batch, 8, 8, 3)


def drawn(module: nn.Module, x: jax.Array) -> dict:
    """Parameters from NumPy, of the scale that an initialiser gives: nothing to compile."""
    rng = np.random.default_rng(0)
    shapes = jax.eval_shape(module.init, jax.random.key(0), x)
    return jax.tree.map(
        lambda s: jnp.asarray(rng.normal(0, np.prod(s.shape[:-1]) ** -0.5, s.shape), jnp.float32), shapes
    )


def test_instance_norm_erases_amplitude_and_the_statistics_bring_it_back():
    S = maps(8, 8, 3) - 2  # about zero, so that doubling is all that changes

    def change(statistics: bool) -> float:
        encoder = MapEncoder((4, 4), 5, statistics=statistics)
        params = jax.tree.map(lambda p: p if p.ndim > 1 else jnp.ones_like(p), drawn(encoder, S))
        params["params"]["DownConvolution_0"]["bias"] *= 0
        z, doubled = jax.jit(lambda S: (encoder.apply(params, S), encoder.apply(params, 2 * S)))(S)
        return float(jnp.abs(doubled - z).max() / jnp.abs(z).max())

    assert change(False) < 1e-3
    assert change(True) > 0.05


def test_a_decoder_begun_at_zero_puts_out_its_skip_alone():
    decoder = MapDecoder((2, 3), 8, skip=True, output_scale=0.0)
    z = maps(4)
    S, variables = jax.jit(decoder.init_with_output)(fast_key(0), z)
    skip = variables["params"]["skip"]
    np.testing.assert_allclose(S.reshape(-1), z @ skip["kernel"], atol=1e-3)
