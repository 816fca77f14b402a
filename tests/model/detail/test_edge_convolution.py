"""The EdgeConv layer against a loop over ragged neighbours, and its gradient against jax's own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.geometry.topology import neighbour_table
from garment_jax.model.detail.edge_convolution import edge_convolution, edge_table, gathered_max

# A fan round vertex 0, a flap at vertex 5, and vertex 7 without a triangle: valences 0 to 5.
FACES = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [4, 6, 5]], np.int32)
VERTICES = 8
RINGS = [[1, 2, 3, 4, 5], [0, 2], [0, 1, 3], [0, 2, 4], [0, 3, 5, 6], [0, 4, 6], [4, 5], []]
TABLE = edge_table(neighbour_table(FACES, VERTICES))


def naive(params: dict, x: np.ndarray, unit: float) -> np.ndarray:
    """EdgeConv of one frame `[n, c]`, an edge at a time and leaky ReLU inside the maximum."""
    y = np.zeros((len(x), params["kernel"].shape[1]))
    for i, ring in enumerate(RINGS):
        edges = []
        for j in ring or [i]:
            z = np.concatenate([x[i], (x[j] - x[i]) / unit]) @ params["kernel"] + params["bias"]
            edges.append(np.where(z > 0, z, 0.2 * z))
        y[i] = np.max(edges, axis=0)
    return y


def random_layer(seed: int, inputs: int, width: int) -> dict:
    rng = np.random.default_rng(seed)
    kernel = rng.normal(size=(2 * inputs, width)).astype(np.float32)
    return {"kernel": kernel, "bias": rng.normal(size=width).astype(np.float32)}


def test_the_rings_are_those_of_the_faces():
    for i, ring in enumerate(RINGS):
        assert sorted(TABLE.index[i][TABLE.real[i]]) == (ring or [i])
        assert set(TABLE.index[i]) == set(ring or [i]), "padding must not bring in another vertex"


@pytest.mark.parametrize("unit", [1.0, 0.25])
@pytest.mark.parametrize("batch", [(), (2,), (2, 3)])
def test_equals_a_loop_over_ragged_neighbours(batch, unit):
    params = random_layer(0, 3, 8)
    x = np.random.default_rng(1).normal(size=(*batch, VERTICES, 3)).astype(np.float32)
    found = edge_convolution(params, jnp.moveaxis(x, -1, 0), TABLE, difference_unit=unit)
    wanted = np.stack([naive(params, frame, unit) for frame in x.reshape(-1, VERTICES, 3)])
    np.testing.assert_allclose(
        np.moveaxis(found, 0, -1), wanted.reshape(*batch, VERTICES, 8), rtol=1e-5, atol=1e-5
    )


def test_a_vertex_does_not_count_as_its_own_neighbour():
    # All neighbours lie below the vertex: if padding put the vertex itself in, 0 would win.
    x = -jnp.ones((1, VERTICES)).at[0, 1].set(-5.0)
    assert gathered_max(x, TABLE)[0, 1] == -1.0
    assert gathered_max(-x, TABLE)[0, 1] == 1.0  # and not its own 5


def plain_max(x: jax.Array) -> jax.Array:
    """The maximum over real neighbours, differentiated by jax."""
    real = jnp.broadcast_to(TABLE.real, (*x.shape[:-1], *TABLE.real.shape))
    return jnp.where(real, x[..., TABLE.index], -jnp.inf).max(axis=-1)


@pytest.mark.parametrize("ties", [False, True])
def test_the_gathered_gradient_equals_the_scattered_one(ties):
    rng = np.random.default_rng(2)
    x = rng.normal(size=(4, 3, VERTICES)).astype(np.float32)
    x = jnp.asarray(np.round(x) if ties else x)  # equal neighbours share the gradient
    weight = rng.normal(size=x.shape).astype(np.float32)
    found = jax.jit(jax.grad(lambda x: (weight * gathered_max(x, TABLE)).sum()))(x)
    wanted = jax.jit(jax.grad(lambda x: (weight * plain_max(x)).sum()))(x)
    np.testing.assert_array_equal(gathered_max(x, TABLE), plain_max(x))
    np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-6)


def test_the_gradient_is_finite_where_all_vertices_are_equal():
    gradient = jax.jit(jax.grad(lambda x: gathered_max(x, TABLE).sum()))(jnp.zeros((2, VERTICES)))
    assert np.isfinite(gradient).all()
    assert gradient.sum() == pytest.approx(2 * VERTICES)
