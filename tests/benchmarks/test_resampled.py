import numpy as np
import pytest

from tests.benchmarks.scripts import script
from tests.reference.scene import make_scene

resampled = script("resampled")


def test_the_same_grid_gives_the_same_garment_and_pins():
    scene = make_scene(5, 8)
    same = resampled.resample(scene, 5, 8).scene
    np.testing.assert_allclose(same.garment.template, scene.garment.template, atol=1e-5)
    np.testing.assert_array_equal(same.garment.faces, scene.garment.faces)
    np.testing.assert_array_equal(same.garment.faces_uv, scene.garment.faces_uv)
    np.testing.assert_array_equal(same.pins.vertices, scene.pins.vertices)
    np.testing.assert_allclose(same.pins.weights, scene.pins.weights, atol=1e-5)


def test_what_is_linear_between_the_old_vertices_is_carried_exactly():
    scene = make_scene(5, 8)
    grid = resampled.resample(scene, 9, 16)
    height = scene.garment.template[None, :, 1:2] * np.array([1.0, 2.0, -3.0])  # linear in v, two frames
    frames = np.concatenate([height, height + 1])
    found = grid.carry(frames)
    assert found.shape == (2, 9 * 16, 3)
    wanted = np.repeat(1.0 - 0.5 * np.linspace(0, 1, 9), 16)
    np.testing.assert_allclose(found[0], wanted[:, None] * [1.0, 2.0, -3.0], atol=1e-5)
    np.testing.assert_allclose(found[1], found[0] + 1, atol=1e-5)


def test_a_finer_grid_is_closed_at_the_seam_and_pinned_along_its_top():
    grid = resampled.resample(make_scene(5, 8), 9, 16).scene
    sides = [grid.garment.faces[:, [i, j]] for i, j in ((0, 1), (1, 2), (2, 0))]
    edges = np.sort(np.concatenate(sides), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert (count == 1).sum() == 2 * 16  # waist and hem alone
    np.testing.assert_array_equal(grid.pins.vertices, np.arange(16))
    np.testing.assert_allclose(grid.pins.weights.sum(axis=1), 1, atol=1e-6)


def test_uvs_that_leave_holes_are_refused():
    scene = make_scene(5, 8)
    half = scene.garment._replace(uv=scene.garment.uv * np.float32(0.5))
    with pytest.raises(ValueError, match="grid points lie outside the garment's UVs; take a garment"):
        resampled.resample(scene._replace(garment=half), 5, 8)
