"""jax 0.10.2 returns wrong numbers in silence on a CPU (jax issue 39103): skinning's very pattern.

A jitted, vmapped 3 x 3 matrix-vector product that is reduced, from 32,769 rows in float32 and
16,385 in float64. Checked right: 0.10.0, 0.10.1, 0.11.0, 0.11.1, 0.11.2, 0.12.0, 0.12.0.1.
"""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import pytest


@pytest.fixture(autouse=True)
def optimised() -> Iterator[None]:
    """Compile as users do: the wrong numbers come from a pass that the other tests leave out."""
    before = jax.config.values["jax_disable_most_optimizations"]
    jax.config.update("jax_disable_most_optimizations", False)
    yield
    jax.config.update("jax_disable_most_optimizations", before)


@pytest.mark.parametrize(("dtype", "rows"), [("float32", 32_769), ("float64", 16_385)])
def test_vmapped_matrix_vector_product_with_a_reduction(dtype: str, rows: int) -> None:
    with jax.enable_x64(dtype == "float64"):
        points = np.zeros((rows, 3), dtype)
        points[:, 0] = np.arange(rows)
        rotation = jnp.eye(3, dtype=dtype)
        squared = jax.jit(jax.vmap(lambda point: jnp.sum((rotation @ point) ** 2)))(jnp.asarray(points))
    expected = np.sum(points.astype(np.float64) ** 2, axis=1)
    np.testing.assert_allclose(np.asarray(squared), expected, rtol=1e-6)
