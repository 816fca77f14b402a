"""The convolution blocks of E_gen, E_s and D_dyn (paper 3.2 and 4.1), one frame at a time, channels last."""

from collections.abc import Sequence

import flax.linen as nn
import jax
import jax.numpy as jnp

SLOPE = 0.2  # of the leaky ReLU


def leaky(x: jax.Array) -> jax.Array:
    """Return the leaky ReLU of `x`."""
    return nn.leaky_relu(x, SLOPE)


class InstanceNorm(nn.Module):
    """Normalise each channel of one map `[h, w, c]` over its texels; affine; eps as PyTorch's, 1e-5."""

    @nn.compact
    def __call__(self, x: jax.Array) -> jax.Array:
        mean = x.mean(axis=(0, 1), keepdims=True)
        variance = jnp.square(x - mean).mean(axis=(0, 1), keepdims=True)
        scale = self.param("scale", nn.initializers.ones, (x.shape[-1],))
        bias = self.param("bias", nn.initializers.zeros, (x.shape[-1],))
        return (x - mean) * jax.lax.rsqrt(variance + 1e-5) * scale + bias


class MapEncoder(nn.Module):
    """Four stride-2 convolutions and a dense layer: a UV map `[h, w, 3]` -> `[features]`.

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
    dense_scale: float = 1.0  # of the dense layer's start; 0 begins from the skip alone

    @nn.compact
    def __call__(self, S: jax.Array) -> jax.Array:
        x, inputs = S, []
        for width in self.channels:
            x = nn.Conv(width, (4, 4), strides=(2, 2), padding=((1, 1), (1, 1)))(x)
            if self.statistics:
                mean = x.mean(axis=(0, 1))
                inputs += [mean, jnp.sqrt(jnp.square(x - mean).mean(axis=(0, 1)) + 1e-6)]
            if self.instance_norm:
                x = InstanceNorm()(x)
            x = leaky(x)
        flat = jnp.concatenate([x.reshape(-1), *inputs])
        start = nn.initializers.variance_scaling(self.dense_scale**2 or 1e-10, "fan_in", "normal")
        out = nn.Dense(self.features, kernel_init=start)(flat)
        if self.skip:
            out = out + nn.Dense(self.features, use_bias=False, name="skip")(pool(S, self.skip).reshape(-1))
        return out


def pool(S: jax.Array, size: int) -> jax.Array:
    """Return the mean of `S` `[h, w, c]` over a `size` x `size` grid of blocks."""
    h, w, c = S.shape
    return S.reshape(size, h // size, size, w // size, c).mean(axis=(1, 3))


class UpConvolution(nn.Module):
    """A 4 x 4 stride-2 transposed convolution `[h, w, c] -> [2h, 2w, width]`, split into its phases.

    The four output phases are one 2 x 2 convolution of the padded input, shifted: a quarter of the
    FLOPs of XLA's transposed convolution on CPU, which multiplies the zeros that it inserts.
    """

    width: int
    start: nn.initializers.Initializer = nn.initializers.lecun_normal()

    @nn.compact
    def __call__(self, x: jax.Array) -> jax.Array:
        h, w, _ = x.shape
        phases = nn.Conv(4 * self.width, (2, 2), padding=((1, 1), (1, 1)), use_bias=False, kernel_init=self.start)(x)
        bias = self.param("bias", nn.initializers.zeros, (self.width,))
        phases = phases.reshape(h + 1, w + 1, 2, 2, self.width)
        rows = [
            jnp.stack([phases[a : a + h, b : b + w, a, b] for b in (0, 1)], axis=2) for a in (0, 1)
        ]
        return jnp.stack(rows, axis=1).reshape(2 * h, 2 * w, self.width) + bias


class MapDecoder(nn.Module):
    """A dense layer and four up-convolutions: `[features]` -> a UV map `[size, size, 3]`.

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
        x = leaky(nn.Dense(side * side * widths[0])(z)).reshape(side, side, widths[0])
        for width in widths[1:]:
            x = UpConvolution(width)(x)
            if self.instance_norm:
                x = InstanceNorm()(x)
            x = leaky(x)
        start = nn.initializers.variance_scaling(self.output_scale**2 or 1e-10, "fan_in", "normal")
        S = UpConvolution(3, start=start)(x)
        if self.skip:
            S = S + nn.Dense(self.size * self.size * 3, use_bias=False, name="skip")(z).reshape(S.shape)
        return S
