"""Crossings of a sheet with itself, against every edge and triangle that SciPy's tree finds near."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import garment_jax.geometry.self_crossings as module
from garment_jax.evaluation.self_intersections import self_intersections
from garment_jax.geometry.self_crossings import find_self_crossings, make_crossing_tables
from garment_jax.geometry.topology import unique_edges
from tests.postprocess.sheets import FACES, SIDE, T, looped
from tests.reference.crossing_edges import crossing_edges
from tests.reference.triangle_distance import triangle_distance


@lru_cache
def find():
    made = make_crossing_tables(T, FACES)
    return jax.jit(lambda V: find_self_crossings(V, made))


def crossing_vertices(V: np.ndarray, faces: np.ndarray) -> set[int]:
    """Return the ends of edges that go through a face and the corners of those faces, one pair at a time."""
    found: set[int] = set()
    V = V.astype(np.float64)
    for edge in unique_edges(faces):
        p, q = V[edge]
        a, b, c = (V[faces[:, k]] for k in range(3))
        n = np.cross(b - a, c - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ((a - p) * n).sum(1) / ((q - p) * n).sum(1)
            x = p + t[:, None] * (q - p)
            sides = [(np.cross(v - u, x - u) * n).sum(1) > 0 for u, v in ((a, b), (b, c), (c, a))]
        apart = ~np.isin(faces, edge).any(axis=1)
        through = apart & (t > 0) & (t < 1) & sides[0] & sides[1] & sides[2]
        if through.any():
            found |= {*edge.tolist(), *faces[through].ravel().tolist()}
    return found


@pytest.mark.parametrize("size", [0.002, 0.006, 0.03])
def test_a_crumpled_sheet_has_the_crossings_of_the_search_by_a_tree(size: float):
    V = (T + size * np.random.default_rng(3).normal(size=T.shape)).astype(np.float32)
    found = find()(V)
    assert int(found.edges) == self_intersections(V, FACES).edges
    assert set(np.flatnonzero(found.vertices).tolist()) == crossing_vertices(V, FACES)
    assert not found.overflow
    assert (size < 0.005) == (int(found.edges) == 0)


def test_of_a_sheet_like_crumpled_paper_some_that_neighbours_hide_may_be_missed():
    V = (T + 0.01 * np.random.default_rng(3).normal(size=T.shape)).astype(np.float32)
    assert 0.98 < int(find()(V).edges) / self_intersections(V, FACES).edges <= 1


def test_a_sheet_that_loops_through_itself_is_found_where_it_does():
    V = looped(0.05)
    found = find()(V)
    assert int(found.edges) == self_intersections(V, FACES).edges > 20
    assert set(np.flatnonzero(found.vertices).tolist()) == crossing_vertices(V, FACES)


def test_a_sheet_in_folds_that_do_not_meet_has_none():
    found = find()(looped(0.03))
    assert int(found.edges) == 0
    assert not found.vertices.any()


@pytest.mark.parametrize("met", [2, 40, len(T)])
def test_points_in_one_place_cross_nothing(met: int):
    """By rounding alone, edges to that place would go through faces that end there."""
    V = np.random.default_rng(1).normal(0.0, 0.001, T.shape).astype(np.float32) + T
    near = np.argsort(np.linalg.norm(V - V[SIDE * 7 + 9], axis=1))[:met]
    V[near] = V[near[0]]
    found = find()(V)
    assert int(found.edges) == 0
    assert not found.vertices.any()


def test_many_at_once_are_as_one_by_one():
    together = jnp.stack([jnp.asarray(V) for V in (T, looped(0.05), looped(0.03))])
    alone = [int(find()(V).edges) for V in together]
    assert np.array_equal(jax.vmap(find())(together).edges, alone)


def test_a_vertex_that_pokes_through_another_layer_is_found_wherever_it_is():
    n = len(T)  # of layers whose borders do not lie upon each other, so that patches hold faces of two
    centred = T - T.mean(axis=0)
    V = np.concatenate([(1 - 0.02 * k) * centred - np.float32([0, 0.008 * k, 0]) for k in range(3)])
    faces = np.concatenate([FACES + n * k for k in range(3)])
    tables = make_crossing_tables(V, faces)
    count = jax.jit(lambda V: find_self_crossings(V, tables).edges)
    for vertex in (
        k for k in range(2 * n, 3 * n) if 0 < k % SIDE < SIDE - 1 and 0 < k % n // SIDE < SIDE - 1
    ):
        poked = V.copy()
        poked[vertex, 1] += 0.0081
        assert int(count(poked)) > 0, divmod(vertex, SIDE)


def test_what_is_not_finite_crosses_nothing():
    V = looped(0.05)
    V[7, 1] = np.nan
    assert int(find()(V).edges) == 0


@pytest.mark.parametrize("size", [0.03, 0.04, 0.06])
def test_loops_cross_as_ipctk_counts_them(size: float):
    V = looped(size) + 1e-4 * np.random.default_rng(1).normal(size=T.shape).astype(np.float32)
    assert int(find()(V).edges) == crossing_edges(V, unique_edges(FACES), FACES)
    assert (size > 0.037) == (int(find()(V).edges) > 0)


def test_pairs_of_triangles_cross_as_ipctk_counts_them():
    faces = np.array([[0, 1, 2], [3, 4, 5]], np.int32)
    frames = np.random.default_rng(2).normal(size=(200, 6, 3)).astype(np.float32)
    tables = make_crossing_tables(frames[0], faces)
    found = jax.jit(jax.vmap(lambda V: find_self_crossings(V, tables).edges))(frames)
    assert found.tolist() == [crossing_edges(V, unique_edges(faces), faces) for V in frames]
    assert 0 < np.count_nonzero(found) < 200


def test_two_triangles_through_each_other():
    faces = np.array([[0, 1, 2], [3, 4, 5]], np.int32)
    V = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [0.2, -1, 0.2], [0.2, 1, 0.2], [5, 1, 5]], np.float32)
    made = make_crossing_tables(V, faces)
    assert int(find_self_crossings(jnp.asarray(V), made).edges) == 2
    V[4] = [0.2, -0.5, 0.2]  # no longer as far as the other
    V[5] = [5, -0.5, 5]
    assert int(find_self_crossings(jnp.asarray(V), made).edges) == 0


PAIR = np.array([[0, 1, 2], [3, 4, 5]], np.int32)
MICROMETRE = 1e-6


def test_a_vertex_and_a_triangle_cross_from_where_they_meet():
    face = np.array([[0, 0, 0], [0.03, 0, 0], [0, 0.03, 0]])
    above = np.array([[0.01, 0.01, 0], [0.02, 0, 0.03], [0, 0.02, 0.03]])  # its first corner over the face
    _cross_once_they_meet(face, above)


def test_two_edges_cross_from_where_they_meet():
    below = np.array([[-0.01, 0, 0], [0.02, 0, 0], [0, 0, -0.03]])
    above = np.array([[0, -0.02, 0], [0, 0.01, 0], [0, 0, 0.03]])
    _cross_once_they_meet(below, above)


def _cross_once_they_meet(one: np.ndarray, other: np.ndarray) -> None:
    """Hold the verdict and ipctk's distance against `other` a little above and below where both meet."""
    for lift in (MICROMETRE, -MICROMETRE):
        V = np.concatenate([one, other + [0, 0, lift]]).astype(np.float32)
        crossed = int(find_self_crossings(jnp.asarray(V), make_crossing_tables(V, PAIR)).edges)
        assert (crossed > 0) == (lift < 0)
    assert abs(triangle_distance(one, other + [0, 0, MICROMETRE]) - MICROMETRE) < 1e-12


def test_triangles_cease_to_cross_where_ipctk_has_a_distance_between_them():
    draws = np.random.default_rng(5)
    start = 0.03 * draws.normal(size=(200, 6, 3))
    way = draws.normal(size=(200, 1, 3))
    way *= 0.5 / np.linalg.norm(way, axis=-1, keepdims=True)
    tables = make_crossing_tables(start[0], PAIR)

    def moved(by: np.ndarray) -> np.ndarray:
        both = start[:, :3], start[:, 3:] + by[:, None, None] * way
        return np.concatenate(both, axis=1).astype(np.float32)

    crossed = jax.jit(jax.vmap(lambda V: find_self_crossings(V, tables).edges > 0))
    chosen = np.asarray(crossed(moved(np.zeros(200))))
    assert 40 < np.count_nonzero(chosen) < 160
    low, high = np.zeros(200), np.ones(200)
    for _ in range(30):
        middle = (low + high) / 2
        still = np.asarray(crossed(moved(middle)))
        low, high = np.where(still, middle, low), np.where(still, high, middle)
    apart = [triangle_distance(V[:3], V[3:]) for V in moved(high)[chosen]]
    assert max(apart) <= MICROMETRE  # the verdict changes where they touch
    further = moved(high + 4 * MICROMETRE)[chosen]
    assert not np.asarray(crossed(moved(high + 4 * MICROMETRE)))[chosen].any()
    assert min(triangle_distance(V[:3], V[3:]) for V in further) > 0


def test_more_pairs_than_there_is_room_for_are_said(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "PAIRS", module.AT_ONCE)
    V = (0.02 * np.random.default_rng(0).normal(size=T.shape)).astype(np.float32)  # all upon each other
    assert find_self_crossings(jnp.asarray(V), make_crossing_tables(T, FACES)).overflow


def test_every_edge_and_face_lies_in_one_group():
    made = make_crossing_tables(T, FACES)
    assert set(made.edge.ravel().tolist()) == set(range(len(made.ends)))
    corners = {tuple(face) for face in made.faces.reshape(3, -1).T.tolist()}
    assert corners == {tuple(face) for face in FACES.tolist()}
