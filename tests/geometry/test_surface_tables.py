import numpy as np
import pytest

from garment_jax.geometry.surface_tables import BRANCH, LEAF, make_surface_tables, point_groups
from tests.geometry.surfaces import bumpy


def test_every_triangle_is_there_and_short_leaves_repeat_theirs():
    vertices, faces = bumpy()
    tables = make_surface_tables(vertices, faces)
    assert len(tables.faces) % LEAF == 0
    np.testing.assert_array_equal(np.unique(tables.order), np.arange(len(faces)))
    np.testing.assert_array_equal(tables.faces, faces[tables.order])


def test_leaves_and_branches_name_each_vertex_of_theirs():
    tables = make_surface_tables(*bumpy())
    for rows, named in ((LEAF, tables.corners), (LEAF * BRANCH, tables.branches)):
        faces = tables.faces.reshape(-1, 3 * rows)
        assert len(faces) == len(named)
        assert all(set(a.tolist()) == set(b.tolist()) for a, b in zip(faces, named, strict=True))
    for leaf, three in zip(tables.corners, tables.spread.T, strict=True):
        assert len(set(three.tolist())) == 3
        assert set(three.tolist()) <= set(leaf.tolist())


def test_across_names_the_triangle_that_shares_the_edge():
    tables = make_surface_tables(*bumpy())
    for row in range(0, len(tables.faces), 37):
        for edge in range(3):
            ends = {int(tables.faces[row, edge]), int(tables.faces[row, (edge + 1) % 3])}
            other = tables.across[row, edge]
            assert tables.order[other] != tables.order[row]
            assert ends <= set(tables.faces[other].tolist())


def test_a_border_edge_has_nobody_across():
    tables = make_surface_tables(np.eye(3), np.array([[0, 1, 2]]))
    assert (tables.order[tables.across] == 0).all()
    assert 0 in tables.border


def test_a_closed_surface_has_no_border_and_its_triangles_are_counted_once():
    tables = make_surface_tables(*bumpy())
    assert len(tables.border) == 0
    assert sorted(tables.order[tables.once]) == list(range(tables.order.max() + 1))
    assert all(v in tables.faces[row] for v, row in enumerate(tables.corner_of))


def test_incidence_lists_every_corner_once_also_at_a_fan():
    angle = np.linspace(0, 2 * np.pi, 30, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    vertices = np.concatenate([ring, [[0, 0, 0.5], [0, 0, -0.5]]])
    around = np.arange(30)
    after = np.roll(around, -1)
    top = np.stack([around, after, np.full(30, 30)], axis=1)
    bottom = np.stack([after, around, np.full(30, 31)], axis=1)
    faces = np.concatenate([top, bottom])
    tables = make_surface_tables(vertices, faces)
    np.testing.assert_array_equal(tables.wide, [30, 31])
    for vertex in range(32):
        fan = tables.fan[vertex] if vertex < 30 else tables.wide_fan[tables.wide_place[vertex]]
        around = {tuple(pair) for pair in fan.tolist() if pair != [vertex, vertex]}
        expected = set()
        for face in faces[(faces == vertex).any(axis=1)].tolist():
            k = face.index(vertex)
            expected.add((face[(k + 1) % 3], face[(k + 2) % 3]))
        assert around == expected
    assert (tables.wide_place[:30] == -1).all()


def test_point_groups_hold_every_point_and_begin_in_the_middle():
    points = np.random.default_rng(0).normal(size=(101, 3))
    groups = point_groups(points)
    assert groups.shape[1] == 8
    np.testing.assert_array_equal(np.unique(groups), np.arange(101))
    for group in groups:
        apart = np.linalg.norm(points[group] - points[np.unique(group)].mean(axis=0), axis=1)
        assert apart[0] == apart.min()


def test_refusals_name_value_and_remedy():
    with pytest.raises(ValueError, match="0 faces; give a closed"):
        make_surface_tables(np.eye(3), np.zeros((0, 3), int))
    with pytest.raises(ValueError, match="vertex 7 of 3"):
        make_surface_tables(np.eye(3), np.array([[0, 1, 7]]))
    with pytest.raises(ValueError, match="vertex -1 of 3"):
        make_surface_tables(np.eye(3), np.array([[0, 1, -1]]))
