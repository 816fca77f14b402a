import numpy as np
import pytest

from garment_jax.collision import make_collider_tables, make_collision_tables
from garment_jax.collision.tables import lipschitz, transposed_weights
from garment_jax.geometry.laplacian import cotangent_table, uniform_table
from garment_jax.structs import Collider
from tests.collision.cloth import sheet, tables
from tests.reference.scene import make_scene


def dense(index: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return the weights as a matrix, by a loop."""
    matrix = np.zeros((len(index), len(index)))
    for i in range(len(index)):
        for j, w in zip(index[i], weight[i], strict=True):
            matrix[i, j] += w
    return matrix


@pytest.mark.parametrize("kind", ["uniform", "cotangent"])
def test_transposed_weights_are_the_transpose(kind):
    V, faces = sheet()
    V = V + np.random.default_rng(0).normal(scale=0.01, size=V.shape)
    table = uniform_table(faces, len(V)) if kind == "uniform" else cotangent_table(V, faces)
    forward, back = dense(table.index, table.weight), dense(table.index, transposed_weights(table))
    np.testing.assert_allclose(back, forward.T, atol=1e-7)


def test_transposed_weights_of_fifty_thousand_vertices():
    n = 50_000  # its square is beyond 32 bits
    k = np.arange(n - 2, dtype=np.int32)
    table = uniform_table(np.stack([k, k + 1, k + 2], axis=1), n)  # a strip
    back = transposed_weights(table)
    i = np.random.default_rng(0).integers(2, n - 2, 1000)
    for j in (i - 2, i - 1, i + 1, i + 2):
        there = (table.weight[j] * (table.index[j] == i[:, None])).sum(axis=1)
        here = (back[i] * (table.index[i] == j[:, None])).sum(axis=1)
        np.testing.assert_allclose(here, there)


def test_lipschitz_is_just_above_the_largest_eigenvalue():
    V, faces = sheet()
    table = uniform_table(faces, len(V))
    matrix = dense(table.index, table.weight) - np.eye(len(V))
    largest = np.linalg.norm(matrix, 2) ** 2
    assert largest <= lipschitz(table, transposed_weights(table)) <= 1.1 * largest


def test_collider_tables_take_the_cap_as_their_last_vertex():
    scene = make_scene()
    assert scene.collider is not None
    surface = make_collider_tables(scene.collider, scene.body)
    assert surface.faces.max() == len(scene.collider.body_vertices) - (not len(scene.collider.cap_loop))


def test_refusals_name_value_and_remedy():
    scene = make_scene()
    assert scene.collider is not None
    wrong = Collider(np.array([0, 99999]), np.zeros(0, int), scene.collider.faces)
    with pytest.raises(ValueError, match="names vertex 99999 of a body"):
        make_collider_tables(wrong, scene.body)
    V, faces = sheet()
    with pytest.raises(ValueError, match="575 vertices and the Laplacian 576"):
        make_collision_tables(V[:-1], uniform_table(faces, len(V)), tables()[0].surface)
