import numpy as np
import pytest

from garment_jax.geometry.laplacian import uniform_table
from garment_jax.postprocess.collision import make_collider_tables, make_collision_tables
from garment_jax.structs import Collider
from tests.postprocess.collision.cloth import sheet, tables
from tests.reference.scene import make_scene


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
