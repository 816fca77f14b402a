"""Up-convolutions as the networks have them, against XLA's own transposed convolution.

The layers of D_dyn at UV 128 x 128 (one frame) and 64 x 64 (one frame, a training batch of 48). Times are
the best of fifteen, rates count four taps a texel of the output. `regressions.py` holds the ratio to a bound.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from machine_rates import best_seconds

from garment_jax.model.generative.convolution import up_convolution

DECODERS = {"UV 128": (128, 1), "UV 64": (64, 1), "UV 64, batch of 48": (64, 48)}
CHANNELS = (24, 48, 96, 128)
REPEATS = 16  # products in a row in one program: one alone is shorter than a call


def transposed(x: jax.Array, phases: jax.Array) -> jax.Array:
    """Return the transposed convolution as XLA has it: zeros between the texels (another kernel order)."""
    kernel = phases.reshape(4, 4, phases.shape[2], -1)
    return jax.lax.conv_general_dilated(
        x,
        kernel,
        (1, 1),
        ((2, 2), (2, 2)),
        lhs_dilation=(2, 2),
        dimension_numbers=("NHWC", "HWIO", "NHWC"),
    )


WAYS: dict[str, Callable] = {"networks": up_convolution, "transposed": transposed}


def layers(size: int) -> list[tuple[int, int, int]]:
    """Return side, inputs and outputs of a decoder's up-convolutions."""
    widths = [*reversed(CHANNELS), 3]
    return [(size >> (4 - i), widths[i], widths[i + 1]) for i in range(4)]


def seconds(way: Callable, x: jax.Array, kernel: jax.Array) -> float:
    """Return the shortest time of one up-convolution among `REPEATS` in a row."""

    def run(x: jax.Array, kernel: jax.Array) -> tuple[jax.Array, jax.Array]:
        def again(x: jax.Array, _):
            y = way(x, kernel)
            return 0.999 * x + 1e-9 * y.ravel()[0], y

        return jax.lax.scan(again, x, None, length=REPEATS)

    return best_seconds(jax.jit(run), x, kernel, repeats=15) / REPEATS


def measured() -> list[dict]:
    """Return a row for every layer."""
    rng, rows = np.random.default_rng(0), []
    for name, (size, batch) in DECODERS.items():
        for side, inputs, outputs in layers(size):
            x = jnp.asarray(rng.normal(size=(batch, side, side, inputs)), jnp.float32)
            kernel = jnp.asarray(rng.normal(size=(2, 2, inputs, 4 * outputs)), jnp.float32)
            flops = 2 * 4 * inputs * outputs * batch * (2 * side) ** 2
            row: dict = {"decoder": name, "layer": f"{side}^2 x {inputs} -> {outputs}", "MFLOP": flops / 1e6}
            for way, function in WAYS.items():
                row[f"{way} ms"] = 1e3 * seconds(function, x, kernel)
            row["ratio"] = row["networks ms"] / row["transposed ms"]
            rows.append(row | {"GFLOP/s": flops / row["networks ms"] / 1e6})
    return rows


def decoder_ratios(rows: list[dict]) -> dict[str, float]:
    """Return the time of each decoder's layers together, of the transposed ones'."""
    found = {}
    for name in {row["decoder"]: None for row in rows}:
        own = [row for row in rows if row["decoder"] == name]
        networks, transposed = (sum(row[f"{way} ms"] for row in own) for way in WAYS)
        found[name] = networks / transposed
    return found
