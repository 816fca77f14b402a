"""The two stride-2 convolutions of the networks, with weight gradients as matrix products.

XLA's convolutions are good forwards and for the input's gradient on a CPU, but its weight gradient ran
at 1 to 2 GFLOP/s for the up-convolution's 2 x 2 kernels, against 30 to 50 for the products used here
(two cores). Leading axes are batch axes: under `vmap` every frame
would get a weight gradient of its own, summed afterwards.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

_LAYOUT = ("NHWC", "HWIO", "NHWC")


def _convolve(x: jax.Array, kernel: jax.Array, stride: int) -> jax.Array:
    # the padding that makes a 4 x 4 stride-2 and a 2 x 2 stride-1 window fit is 1 on every side
    return jax.lax.conv_general_dilated(
        x, kernel, (stride, stride), ((1, 1), (1, 1)), dimension_numbers=_LAYOUT
    )


@jax.custom_vjp
def _down(x: jax.Array, kernel: jax.Array) -> jax.Array:
    return _convolve(x, kernel, 2)


def _down_forward(x: jax.Array, kernel: jax.Array):
    return _down(x, kernel), (x, kernel)


def _down_backward(residual: tuple[jax.Array, jax.Array], g: jax.Array):
    x, kernel = residual
    (dx,) = jax.vjp(lambda x: _convolve(x, kernel, 2), x)[1](g)
    b, h, w, c = x.shape
    # rows split by parity, columns by pairs: every slice below is a plain matrix
    blocks = jnp.pad(x, ((0, 0), (1, 1), (1, 1), (0, 0))).reshape(b, h // 2 + 1, 2, w // 2 + 1, 2 * c)
    flat = g.reshape(-1, g.shape[-1])

    def product(i: int, j: int) -> jax.Array:
        part = blocks[:, i // 2 : i // 2 + h // 2, i % 2, j : j + w // 2]
        return part.reshape(-1, 2 * c).T @ flat

    rows = [jnp.concatenate([product(i, 0), product(i, 1)]) for i in range(4)]
    return dx, jnp.stack(rows).reshape(kernel.shape)


_down.defvjp(_down_forward, _down_backward)


@jax.custom_vjp
def _windows(x: jax.Array, kernel: jax.Array) -> jax.Array:
    return _convolve(x, kernel, 1)


def _windows_forward(x: jax.Array, kernel: jax.Array):
    return _windows(x, kernel), (x, kernel)


def _windows_backward(residual: tuple[jax.Array, jax.Array], g: jax.Array):
    x, kernel = residual
    (dx,) = jax.vjp(lambda x: _convolve(x, kernel, 1), x)[1](g)
    _, h, w, c = x.shape
    padded, flat = jnp.pad(x, ((0, 0), (1, 1), (1, 1), (0, 0))), g.reshape(-1, g.shape[-1])
    parts = [padded[:, i : i + h + 1, j : j + w + 1].reshape(-1, c).T @ flat for i in (0, 1) for j in (0, 1)]
    return dx, jnp.stack(parts).reshape(kernel.shape)


_windows.defvjp(_windows_forward, _windows_backward)


def down_convolution(x: Float[Array, "*b h w c"], kernel: Float[Array, "4 4 c o"]) -> jax.Array:
    """Return the 4 x 4 stride-2 convolution of `x`, padded by 1: `[*b, h/2, w/2, o]`."""
    batch = x.shape[:-3]
    y = _down(x.reshape(-1, *x.shape[-3:]), kernel)
    return y.reshape(*batch, *y.shape[1:])


def up_convolution(x: Float[Array, "*b h w c"], kernel: Float[Array, "2 2 c o4"]) -> jax.Array:
    """Return the 4 x 4 stride-2 transposed convolution of `x`, padded by 1: `[*b, 2h, 2w, o]`.

    `kernel`'s last axis holds the 2 x 2 output phases and then the o channels. All four phases are one
    2 x 2 convolution of the padded input, each read with its own shift: a quarter of the FLOPs of a
    transposed convolution on CPU, which multiplies the zeros that it inserts.
    """
    batch, (h, w) = x.shape[:-3], x.shape[-3:-1]
    phases = _windows(x.reshape(-1, *x.shape[-3:]), kernel)
    width = kernel.shape[-1] // 4
    phases = phases.reshape(-1, h + 1, w + 1, 2, 2, width)
    rows = [jnp.stack([phases[:, a : a + h, b : b + w, a, b] for b in (0, 1)], axis=3) for a in (0, 1)]
    return jnp.stack(rows, axis=2).reshape(*batch, 2 * h, 2 * w, width)
