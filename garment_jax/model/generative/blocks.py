"""The convolution blocks of E_gen, E_s and D_dyn (paper 3.2 and 4.1), channels last.

Leading axes are batch axes (see convolution.py for why not `vmap`).
"""

from collections.abc import Sequence

import flax.linen as nn
import jax
import jax.numpy as jnp

from garment_jax.model.generative.convolution import down_convolution, up_convolution

SLOPE = 0.2  # of the leaky ReLU


def leaky(x: jax.Array) -> jax.Array:
    """Return the leaky ReLU of `x`."""
    return nn.leaky_relu(x, SLOPE)


def along_channels(parameter: jax.Array, x: jax.Array) -> jax.Array:
    """Return `parameter` `[c]` with as many axes as `x` `[..., c]`."""
    return parameter.reshape((1,) * (x.ndim - 1) + parameter.shape)


class InstanceNorm(nn.Module):
    """Normalise each channel of each map `[*b, h, w, c]` over its texels; affine; eps as PyTorch's, 1e-5."""

    @nn.compact
    def __call__(self, x: jax.Array) -> jax.Array:
        mean = x.mean(axis=(-3, -2), keepdims=True)
        variance = jnp.square(x - mean).mean(axis=(-3, -2), keepdims=True)
        scale = self.param("scale", nn.initializers.ones, (x.shape[-1],))
        bias = self.param("bias", nn.initializers.zeros, (x.shape[-1],))
        normal = (x - mean) * jax.lax.rsqrt(variance + 1e-5)
        return normal * along_channels(scale, x) + along_channels(bias, x)


class DownConvolution(nn.Module):
    """A 4 x 4 stride-2 convolution with bias, `[*b, h, w, c] -> [*b, h/2, w/2, width]`."""

    width: int

    @nn.compact
    def __call__(self, x: jax.Array) -> jax.Array:
        kernel = self.param("kernel", nn.initializers.lecun_normal(), (4, 4, x.shape[-1], self.width))
        bias = self.param("bias", nn.initializers.zeros, (self.width,))
        return down_convolution(x, kernel) + along_channels(bias, x)


class UpConvolution(nn.Module):
    """A 4 x 4 stride-2 transposed convolution with bias, `[*b, h, w, c] -> [*b, 2h, 2w, width]`."""

    width: int
    start: nn.initializers.Initializer = nn.initializers.lecun_normal()

    @nn.compact
    def __call__(self, x: jax.Array) -> jax.Array:
        kernel = self.param("kernel", self.start, (2, 2, x.shape[-1], 4 * self.width))
        bias = self.param("bias", nn.initializers.zeros, (self.width,))
        return up_convolution(x, kernel) + along_channels(bias, x)


class MapEncoder(nn.Module):
    """Four stride-2 convolutions and a dense layer: a UV map `[*b, h, w, 3]` -> `[*b, features]`.

    Instance norm erases a map's mean and amplitude, so each layer's channel means and deviations
    join the dense layer's input (`statistics`). `skip` adds a linear layer on the map pooled to
    `skip` x `skip` texels: the part of the code that is a projection need not pass through
    normalisation at all (both are departures; the method asks for them, the paper has neither).
    """

    channels: Sequence[int]
    features: int
    instance_norm: bool = True
    statistics: bool = True
    skip: int = 0
    skip_hidden: int = 0  # width of a hidden layer in the skip; 0 leaves it linear
    dense_scale: float = 1.0  # of the dense layer's start; 0 begins from the skip alone

    @nn.compact
    def __call__(self, S: jax.Array) -> jax.Array:
        x, inputs = S, []
        for width in self.channels:
            x = DownConvolution(width)(x)
            if self.statistics:
                mean = x.mean(axis=(-3, -2), keepdims=True)
                deviation = jnp.sqrt(jnp.square(x - mean).mean(axis=(-3, -2)) + 1e-6)
                inputs += [mean[..., 0, 0, :], deviation]
            if self.instance_norm:
                x = InstanceNorm()(x)
            x = leaky(x)
        flat = jnp.concatenate([flatten(x), *inputs], axis=-1)
        start = nn.initializers.variance_scaling(self.dense_scale**2 or 1e-10, "fan_in", "normal")
        out = nn.Dense(self.features, kernel_init=start)(flat)
        if self.skip:
            out = out + PooledSkip(self.features, self.skip_hidden, name="skip")(flatten(pool(S, self.skip)))
        return out


class PooledSkip(nn.Module):
    """The encoder's path beside the convolutions: pooled map `[*b, 3 p]` -> `[*b, features]`."""

    features: int
    hidden: int

    @nn.compact
    def __call__(self, pooled: jax.Array) -> jax.Array:
        if self.hidden:
            pooled = leaky(nn.Dense(self.hidden, name="hidden")(pooled))
        return nn.Dense(self.features, use_bias=False, name="out")(pooled)


def pool(S: jax.Array, size: int) -> jax.Array:
    """Return the mean of `S` `[*b, h, w, c]` over a `size` x `size` grid of blocks.

    Raises `ValueError` for a map that such a grid does not divide.
    """
    *batch, h, w, c = S.shape
    if h % size or w % size:
        raise ValueError(f"a map of {h} x {w} texels has no {size} x {size} blocks; give uv.size a multiple.")
    return S.reshape(*batch, size, h // size, size, w // size, c).mean(axis=(-4, -2))


def flatten(S: jax.Array) -> jax.Array:
    """Return the maps `S` `[*b, h, w, c]` as vectors."""
    return S.reshape(*S.shape[:-3], -1)


class MapDecoder(nn.Module):
    """A dense layer and four up-convolutions: `[*b, features]` -> a UV map `[*b, size, size, 3]`.

    Symmetrical to `MapEncoder` (paper 3.2, D_dyn). No normalisation and no activation on the output
    layer. `skip` adds a linear layer straight to the map's texels.
    """

    channels: Sequence[int]  # of the encoder, first to last
    size: int
    instance_norm: bool = True
    skip: bool = False
    output_scale: float = 1.0  # of the last layer's start; 0 begins from the skip alone

    @nn.compact
    def __call__(self, z: jax.Array) -> jax.Array:
        widths = list(reversed(self.channels))
        side = self.size // 2 ** len(widths)
        x = leaky(nn.Dense(side * side * widths[0])(z)).reshape(*z.shape[:-1], side, side, widths[0])
        for width in widths[1:]:
            x = UpConvolution(width)(x)
            if self.instance_norm:
                x = InstanceNorm()(x)
            x = leaky(x)
        start = nn.initializers.variance_scaling(self.output_scale**2 or 1e-10, "fan_in", "normal")
        S = UpConvolution(3, start=start)(x)
        if self.skip:
            S = S + nn.Dense(self.size * self.size * 3, name="skip")(z).reshape(S.shape)
        return S
