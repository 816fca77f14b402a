import numpy as np
import pytest
import trimesh

from garment_jax.geometry.boundary import boundary_loops, hem_vertices
from tests.reference.scene import make_scene


def test_a_skirt_has_two_loops_and_the_lower_free_one_is_the_hem():
    scene = make_scene(rings=6, columns=12)
    template, faces = scene.garment.template, scene.garment.faces
    assert [len(loop) for loop in boundary_loops(faces)] == [12, 12]
    lowest = np.flatnonzero(template[:, 1] < template[:, 1].min() + 1e-6)
    np.testing.assert_array_equal(hem_vertices(template, faces, scene.pins.vertices), lowest)
    np.testing.assert_array_equal(hem_vertices(template, faces), lowest)


def test_the_hem_does_not_depend_on_the_order_of_vertices():
    scene = make_scene()
    n = len(scene.garment.template)
    order = np.random.default_rng(7).permutation(n)  # new vertex k is old vertex order[k]
    new_of = np.argsort(order)
    hem = hem_vertices(scene.garment.template[order], new_of[scene.garment.faces])
    old = hem_vertices(scene.garment.template, scene.garment.faces)
    np.testing.assert_array_equal(np.sort(order[hem]), old)


def test_a_pinned_loop_is_no_hem_even_when_it_is_lower():
    scene = make_scene()
    template, faces = scene.garment.template, scene.garment.faces
    bottom = hem_vertices(template, faces)
    top = hem_vertices(template, faces, bottom[:1])
    assert template[top, 1].min() > template[bottom, 1].max()


def test_a_closed_garment_has_no_hem():
    ball = trimesh.creation.icosphere(1)
    with pytest.raises(ValueError, match="no free boundary loop"):
        hem_vertices(ball.vertices, ball.faces)
