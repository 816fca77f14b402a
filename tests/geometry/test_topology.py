import numpy as np
import pytest

from garment_jax.geometry.topology import neighbour_table, unique_edges
from tests.reference.laplacian import one_rings
from tests.reference.scene import make_scene

TWO_TRIANGLES = np.array([[0, 1, 2], [2, 1, 3]], np.int32)


def test_edges_of_two_triangles_share_one():
    np.testing.assert_array_equal(unique_edges(TWO_TRIANGLES), [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]])


def test_neighbours_are_those_of_a_ragged_loop_and_padding_is_the_vertex_itself():
    garment = make_scene(5, 8).garment
    n = len(garment.template)
    index, mask = neighbour_table(garment.faces, n)
    for i, ring in enumerate(one_rings(garment.faces, n)):
        np.testing.assert_array_equal(index[i, mask[i] == 1], sorted(ring))
        assert (index[i, mask[i] == 0] == i).all()


def test_a_vertex_without_faces_has_no_neighbours():
    index, mask = neighbour_table(TWO_TRIANGLES, 5)
    assert mask[4].sum() == 0
    assert (index[4] == 4).all()


def test_euler_characteristic_of_the_closed_body_is_2():
    body = make_scene().body
    assert len(body.vertices) - len(unique_edges(body.faces)) + len(body.faces) == 2


@pytest.mark.parametrize("bad", [4, -1])
def test_a_face_that_names_a_missing_vertex_is_refused(bad):
    with pytest.raises(ValueError, match=f"{bad}.*4 vertices"):
        neighbour_table(np.array([[0, 1, bad]]), 4)
