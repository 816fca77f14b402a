import numpy as np
import pytest

from garment_jax.geometry import winding_number as module
from garment_jax.geometry.winding_number import winding_number
from tests.geometry.surfaces import box, bumpy, sphere
from tests.geometry.surfaces import winding_number as by_loop

POINTS = np.random.default_rng(0).uniform(-0.45, 0.45, size=(300, 3))


def test_a_box_has_its_inside_and_outside():
    inside = (np.abs(POINTS) < [0.3, 0.2, 0.1]).all(axis=1)
    assert inside.any()
    np.testing.assert_allclose(winding_number(POINTS, *box()), inside, atol=1e-12)


def test_equals_the_loop_over_triangles():
    np.testing.assert_allclose(winding_number(POINTS, *bumpy()), by_loop(POINTS, *bumpy()), atol=1e-12)


def test_counts_parts_that_cover_each_other_and_parts_turned_inside_out():
    vertices, faces = sphere()
    both = np.concatenate([vertices, vertices + [0.3, 0.0, 0.0]])
    twice = np.concatenate([faces, faces + len(vertices)])
    points = np.array([[-0.2, 0.0, 0.0], [0.15, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.4, 0.0]])
    np.testing.assert_allclose(winding_number(points, both, twice), [1, 2, 1, 0], atol=1e-12)
    np.testing.assert_allclose(winding_number(points, vertices, faces[:, ::-1]), [-1, -1, 0, 0], atol=1e-12)


def test_on_the_surface_and_at_its_corners_it_is_finite_and_between_both_sides():
    vertices, faces = box()
    on = np.concatenate([vertices, vertices[faces].mean(axis=1)])
    values = winding_number(on, vertices, faces)
    assert np.isfinite(values).all()
    assert ((values > -1e-9) & (values < 1 + 1e-9)).all()


@pytest.mark.parametrize("pairs", [1, 1000, 100_000])
def test_blocks_change_nothing(pairs, monkeypatch):
    whole = winding_number(POINTS, *bumpy())
    monkeypatch.setattr(module, "_PAIRS", pairs)
    np.testing.assert_array_equal(winding_number(POINTS[:40], *bumpy()), whole[:40])


def test_no_points_have_no_winding_numbers():
    assert winding_number(np.zeros((0, 3)), *box()).shape == (0,)
