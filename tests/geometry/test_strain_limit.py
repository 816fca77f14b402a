"""Edges kept near their length: nothing moves that need not, pins stay, what is torn comes back."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.evaluation.cloth import rest_lengths
from garment_jax.geometry.strain_limit import (
    MOMENTUM,
    SHARE,
    SOFT,
    STRETCH,
    TARGET,
    make_strain_tables,
    strain_limited,
)
from garment_jax.geometry.topology import unique_edges
from garment_jax.structs import Garment
from tests.reference.scene import make_scene

SCENE = make_scene()
assert SCENE.pins is not None
PINS, GARMENT = SCENE.pins.vertices, SCENE.garment
T = GARMENT.template
EDGES = unique_edges(GARMENT.faces)
LIMIT = jax.jit(strain_limited)


def change(V: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(V[EDGES[:, 1]] - V[EDGES[:, 0]], axis=1)
    return length / rest_lengths(T, EDGES) - 1.0


def correction(V: np.ndarray) -> np.ndarray:
    """The mean over a vertex' long edges, edge by edge."""
    free = ~np.isin(np.arange(len(T)), PINS)
    moved, among = np.zeros(V.shape), np.zeros(len(V))
    for (a, b), rest in zip(EDGES, rest_lengths(T, EDGES), strict=True):
        way = (V[b] - V[a]).astype(np.float64)
        length = np.linalg.norm(way)
        over = max(length - (1 + TARGET) * rest, 0.0)
        ends = float(free[a]) + float(free[b])
        for v, sign in ((a, 1.0), (b, -1.0)):
            if free[v] and over:
                moved[v] += sign * over / length * way / ends
                among[v] += min(over / (SOFT * rest), 1.0) / ends
    return moved / np.maximum(among, 1.0)[:, None]


def test_a_garment_within_the_limit_and_a_broken_one_come_back_bitwise():
    tables = make_strain_tables(GARMENT, PINS)
    broken = T.copy()
    broken[3] = np.nan
    torn = broken.copy()
    torn[10:30] *= 2
    frames = np.stack([T, T * np.float32(1.2), T * np.float32(0.5), broken, torn])
    for frame in frames:
        np.testing.assert_array_equal(LIMIT(jnp.asarray(frame), tables)[0], frame)


def test_a_garment_pulled_out_or_crumpled_comes_back_and_the_pins_stay():
    tables = make_strain_tables(GARMENT, PINS)
    rng, low = np.random.default_rng(0), T[T[:, 1].argmin()]
    bell = np.exp(-np.square(T - low).sum(axis=1, keepdims=True) / 0.12**2)
    for V in (T + 0.4 * bell * [0, -1, 0], T + rng.normal(scale=0.02, size=T.shape)):
        V = V.astype(np.float32)
        out, steps = LIMIT(jnp.asarray(V), tables)
        before, after = (change(x) > STRETCH for x in (V, np.asarray(out)))
        assert before.mean() > 2 * SHARE
        assert after.mean() <= 2 * SHARE or after.mean() < 0.1 * before.mean()
        assert int(steps) > 0
        np.testing.assert_array_equal(np.asarray(out)[PINS], V[PINS])


@pytest.mark.parametrize("momentum", [0.0, MOMENTUM])
def test_iterations_are_those_of_an_edge_by_edge_loop(momentum):
    V = (T * [1.0, 1.5, 0.6]).astype(np.float32)
    tables = make_strain_tables(GARMENT, PINS)
    out, steps = jax.jit(lambda V: strain_limited(V, tables, iterations=3, momentum=momentum))(jnp.asarray(V))
    assert int(steps) == 3
    x = ahead = V.astype(np.float64)
    for _ in range(3):
        new = ahead + (1 + momentum) / (1 + 2 * momentum) * correction(ahead)
        x, ahead = new, new + momentum * (new - x)
    np.testing.assert_allclose(out, x, atol=3e-6)


def test_momentum_gets_farther_where_much_of_the_cloth_is_pulled_out():
    tables = make_strain_tables(GARMENT, PINS)
    low = T[T[:, 1].argmin()]
    bell = np.exp(-np.square(T - low).sum(axis=1, keepdims=True) / 0.25**2)
    V = jnp.asarray((T + 0.4 * bell * [0, -1, 0]).astype(np.float32))

    def left(iterations: int, momentum: float) -> float:
        out, _ = strain_limited(V, tables, iterations=iterations, momentum=momentum)
        return float(np.maximum(change(np.asarray(out)) - TARGET, 0.0).sum())

    assert left(30, MOMENTUM) < 0.1 * left(30, 0.0)
    assert left(200, MOMENTUM) < 1e-3


def test_a_garment_that_stretches_slowly_does_not_jump():
    tables = make_strain_tables(GARMENT, PINS)
    low = T[T[:, 1].argmin()]
    bell = np.exp(-np.square(T - low).sum(axis=1, keepdims=True) / 0.12**2) * [0, -1, 0]
    pulled = np.linspace(0.0, 0.2, 401)[:, None, None]
    V = (T + pulled * bell).astype(np.float32)
    out, steps = jax.vmap(lambda v: LIMIT(v, tables))(jnp.asarray(V))
    assert steps[0] == 0 < steps[-1]
    # 0.5 mm of pull from one to the next; switched on at once, the correction would jump by centimetres
    jump = np.abs(np.diff(np.asarray(out), axis=0)).max(axis=(1, 2))
    assert jump.max() < 5e-3


def test_edges_without_a_length_do_not_count_and_met_vertices_stay_finite():
    flat = GARMENT._replace(template=np.concatenate([T[:1], T[:-1]]))  # vertices 0 and 1 are one place
    out, _ = LIMIT(jnp.zeros_like(T), make_strain_tables(flat, PINS))
    assert np.isfinite(out).all()
    none = Garment(
        T[:3], np.array([[0, 1, 2]], np.int32), np.zeros((3, 2), np.float32), GARMENT.faces[:1] * 0
    )
    stretched, _ = LIMIT(jnp.asarray(2 * T[:3]), make_strain_tables(none, np.zeros(0, np.int32)))
    assert np.isfinite(stretched).all()
