import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.geometry.laplacian import cotangent_table, laplacian, uniform_table
from tests.reference.laplacian import cotangent_weights, uniform_laplacian
from tests.reference.scene import make_scene

GARMENT = make_scene(5, 8).garment
N = len(GARMENT.template)
TABLES = {
    "uniform": uniform_table(GARMENT.faces, N),
    "cotangent": cotangent_table(GARMENT.template, GARMENT.faces),
}


def grid(size: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """A regular triangulated square: every inner vertex has six neighbours, opposite in pairs."""
    x, y = np.meshgrid(np.arange(size), np.arange(size))
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(size * size)], axis=1).astype(np.float32)
    faces = []
    for row in range(size - 1):
        for column in range(size - 1):
            a = row * size + column
            faces += [(a, a + 1, a + size + 1), (a, a + size + 1, a + size)]
    return vertices, np.array(faces, np.int32)


def inner(size: int = 5) -> np.ndarray:
    return np.arange(size * size).reshape(size, size)[1:-1, 1:-1].ravel()


def random_vertices(*batch: int) -> jax.Array:
    return jnp.asarray(np.random.default_rng(0).normal(size=(*batch, N, 3)), jnp.float32)


def test_uniform_is_the_ragged_loop():
    V = random_vertices()
    expected = uniform_laplacian(np.asarray(V, np.float64), GARMENT.faces)
    np.testing.assert_allclose(laplacian(V, TABLES["uniform"]), expected, atol=1e-6)


def test_cotangent_rows_are_the_ragged_loops():
    table = TABLES["cotangent"]
    dense = np.zeros((N, N))
    for i in range(N):
        np.add.at(dense[i], table.index[i], table.weight[i])
    np.testing.assert_allclose(
        dense, cotangent_weights(GARMENT.template.astype(float), GARMENT.faces), atol=2e-6
    )
    np.testing.assert_allclose(table.weight.sum(axis=1), 1, rtol=1e-6)


@pytest.mark.parametrize("kind", TABLES)
def test_a_translation_is_in_the_null_space(kind):
    V = random_vertices()
    moved = V + jnp.array([[3.0, -2.0, 1.0]])
    np.testing.assert_allclose(laplacian(moved, TABLES[kind]), laplacian(V, TABLES[kind]), atol=2e-6)
    np.testing.assert_allclose(laplacian(jnp.ones((N, 3)), TABLES[kind]), 0, atol=1e-6)


def test_it_points_from_a_raised_vertex_back_to_its_neighbours():
    vertices, faces = grid()
    vertices[12, 2] = 1.0
    out = laplacian(jnp.asarray(vertices), uniform_table(faces, 25))
    np.testing.assert_allclose(out[12], [0, 0, -1], atol=1e-6)
    np.testing.assert_allclose(out[13], [0, 0, 1 / 6], atol=1e-6)


@pytest.mark.parametrize("kind", TABLES)
def test_a_linear_function_on_a_regular_grid_has_none(kind):
    vertices, faces = grid()
    table = uniform_table(faces, 25) if kind == "uniform" else cotangent_table(vertices, faces)
    linear = vertices @ np.array([[2.0, 0, 1], [-1, 1, 0], [0, 0, 1]], np.float32) + np.float32(4)
    assert np.abs(laplacian(jnp.asarray(linear), table)[inner()]).max() < 1e-5


def test_a_triangle_without_area_gives_finite_rows():
    vertices, faces = grid()
    vertices[12] = vertices[13]
    assert np.isfinite(cotangent_table(vertices, faces).weight).all()


def test_a_vertex_without_neighbours_stays_at_zero():
    out = laplacian(jnp.ones((4, 3)) * 7, uniform_table(np.array([[0, 1, 2]]), 4))
    np.testing.assert_allclose(out, 0, atol=1e-6)


def test_a_batch_is_one_by_one():
    V = random_vertices(2, 3)
    out = laplacian(V, TABLES["uniform"])
    for i in range(2):
        for k in range(3):
            np.testing.assert_allclose(out[i, k], laplacian(V[i, k], TABLES["uniform"]), atol=1e-7)
