"""The elastic energy against sums over edges and dense matrices, its gradient against autodiff."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.geometry.elastic import (
    GOLDEN,
    accelerated,
    band_ends,
    disordered,
    edges_of,
    elastic_gradient,
    lipschitz,
    make_elastic_tables,
    ordered,
    transposed_weights,
)
from garment_jax.geometry.laplacian import cotangent_table, uniform_table
from garment_jax.geometry.topology import unique_edges
from tests.postprocess.collision.cloth import sheet

REST, FACES = sheet(0.0)
EDGES = unique_edges(FACES)
LENGTHS = np.linalg.norm(REST[EDGES[:, 0]] - REST[EDGES[:, 1]], axis=1)


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


def union_jack(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a sheet whose vertices have four and eight neighbours in turn."""
    u, v = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    V = 0.02 * np.stack([u.ravel(), 0.1 * np.sin(u + 2.0 * v).ravel(), v.ravel()], axis=1)
    faces = []
    for i in range(side - 1):
        for j in range(side - 1):
            a, b, c, d = i * side + j, (i + 1) * side + j, (i + 1) * side + j + 1, i * side + j + 1
            faces += [[a, b, c], [a, c, d]] if (i + j) % 2 == 0 else [[a, b, d], [b, c, d]]
    return V, np.array(faces, np.int32)


MESHES = {"one band": (REST, FACES), "two bands": union_jack(40), "lone vertices too": None}
MESHES["lone vertices too"] = (
    np.concatenate([np.ones((600, 3)), MESHES["two bands"][0]]),
    MESHES["two bands"][1] + 600,
)


@pytest.mark.parametrize("kind", ["uniform", "cotangent"])
@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize(("size", "crushed"), [(0.97, np.inf), (1.2, np.inf), (0.75, np.inf), (0.75, 1.3)])
def test_the_gradient_is_that_of_the_energy(mesh, kind, size, crushed):
    rest, faces = MESHES[mesh]
    edges = unique_edges(faces)
    lengths = np.linalg.norm(rest[edges[:, 0]] - rest[edges[:, 1]], axis=1)
    table = uniform_table(faces, len(rest)) if kind == "uniform" else cotangent_table(rest, faces)
    t = make_elastic_tables(rest, table, spread=0.13, thickness=0.04, crushed=crushed)
    assert len(t.bands) == 1 + list(MESHES).index(mesh)
    rng = np.random.default_rng(1)
    P = jnp.asarray(size * rest.T.astype(np.float32))
    x = jnp.asarray(rng.normal(0, 0.003, P.shape).astype(np.float32))
    weights = dense(table.index, table.weight)
    laplace = jnp.asarray(weights - np.diag(weights.sum(axis=1)), jnp.float32)

    def energy(x):
        at = P + x
        length = jnp.sqrt(((at[:, edges[:, 0]] - at[:, edges[:, 1]]) ** 2).sum(axis=0))
        square = (length - lengths) ** 2
        if crushed < np.inf:  # below, the force falls with the length, and the energy is without a step
            least = lengths / crushed
            full = (lengths - least) ** 2 + (crushed - 1) * (least**2 - length**2)
            square = jnp.where(length < least, full, square)
        bent = x @ laplace.T
        return 0.5 * ((bent**2).sum() + t.hold * (x**2).sum() + t.spring * square.sum())

    found = elastic_gradient(ordered(x, t), edges_of(ordered(P, t), t), t)
    np.testing.assert_allclose(disordered(found, t), jax.grad(energy)(x), atol=2e-6)


def test_the_bound_is_above_the_largest_curvature_and_near_it():
    t = make_elastic_tables(REST, uniform_table(FACES, len(REST)), spread=0.13, thickness=0.04)
    P = jnp.asarray(1.3 * REST.T.astype(np.float32))  # stretched: all springs pull
    zero, edges = jnp.zeros(P.shape), edges_of(ordered(P, t), t)
    product = jax.jit(lambda d: jax.jvp(lambda x: elastic_gradient(x, edges, t), (zero,), (d,))[1])
    d = jnp.asarray(np.random.default_rng(1).normal(size=P.shape).astype(np.float32))
    for _ in range(200):
        d = product(d)
        largest = float(jnp.linalg.norm(d))
        d = d / largest
    assert 0.4 * t.lipschitz < largest <= t.lipschitz


def test_bands_hold_every_edge_twice_and_less_padding():
    V, faces = union_jack(40)
    table, edges = uniform_table(faces, len(V)), unique_edges(faces)
    t = make_elastic_tables(V, table, spread=0.13, thickness=0.04)
    assert len(t.bands) == 2
    np.testing.assert_array_equal(np.sort(t.order), np.arange(len(V)))
    np.testing.assert_array_equal(disordered(ordered(jnp.arange(len(V)), t), t), np.arange(len(V)))
    found, start = [], 0
    for band in t.bands:
        own = np.broadcast_to(t.order[start : start + band.index.shape[1]], band.index.shape)
        real = t.order[band.index] != own
        found.append(np.stack([own[real], t.order[band.index][real]], axis=1))
        length = np.linalg.norm(V[own] - V[t.order[band.index]], axis=-1)
        np.testing.assert_allclose(band.rest, length, atol=1e-7)
        start += band.index.shape[1]
    assert start == len(V)
    found = np.concatenate(found)
    np.testing.assert_array_equal(np.unique(np.sort(found, axis=1), axis=0), np.sort(edges, axis=1))
    assert len(found) == 2 * len(edges)
    gathered = sum(band.index.size for band in t.bands)
    assert gathered < 0.85 * table.index.size


def test_a_band_is_made_only_where_it_pays():
    assert band_ends(np.full(1000, 6)) == [0]
    assert band_ends(np.array([8] * 3 + [6] * 100)) == [0]  # a fourth of what another band costs
    assert band_ends(np.array([200] + [6] * 1000)) == [0, 1]
    assert band_ends(np.array([8] * 1288 + [5] * 112 + [4] * 1288 + [3] * 112)) == [0, 1400]
    assert band_ends(np.array([40] * 1000 + [20] * 1000 + [8] * 1000 + [7] * 10)) == [0, 1000, 2000]


def test_the_weights_follow_from_two_lengths_and_the_mesh():
    t = make_elastic_tables(REST, uniform_table(FACES, len(REST)), spread=0.1, thickness=0.05)
    mean = LENGTHS.mean()
    assert t.hold == pytest.approx((mean / 0.2) ** 4)
    assert t.spring == pytest.approx((mean / 0.05) ** 2)


def test_momentum_ends_where_it_points_uphill_and_reaches_a_quadratic_minimum():
    scale = jnp.asarray([[1.0], [0.1], [0.02]])
    x = y = jnp.ones((3, 1))
    theta = jnp.ones(())
    for _ in range(200):
        new = y - scale * y
        y, theta = accelerated(new, x, y, theta)
        x = new
    assert jnp.abs(x).max() < 1e-4
    x = jnp.ones((3, 1))
    ahead, theta = accelerated(0.5 * x, x, 0.0 * x, jnp.asarray(9.0))
    np.testing.assert_array_equal(ahead, 0.5 * x)
    assert theta == 1.0
    _, theta = accelerated(0.5 * x, x, 0.0 * x, jnp.asarray(9.0), restart=GOLDEN)
    assert theta == pytest.approx((1 + 5**0.5) / 2)
