import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.geometry.normals import corner_angles, face_normals, unit, vertex_normals
from tests.geometry.surfaces import box, sphere


def test_unit_is_safe_at_zero():
    x = jnp.array([[3.0, 0.0, 4.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(unit(x), [[0.6, 0.0, 0.8], [0.0, 0.0, 0.0]], rtol=1e-6)
    gradient = jax.grad(lambda v: unit(v).sum())(x)
    assert np.isfinite(gradient).all()
    np.testing.assert_array_equal(gradient[1], 0.0)


def test_face_normals_follow_the_right_hand_rule():
    vertices = jnp.array([[0.0, 0.0, 0.0], [1e-4, 0.0, 0.0], [0.0, 1e-4, 0.0]])
    np.testing.assert_allclose(face_normals(vertices, jnp.array([[0, 1, 2]])), [[0, 0, 1]], atol=1e-6)
    np.testing.assert_allclose(face_normals(vertices, jnp.array([[0, 2, 1]])), [[0, 0, -1]], atol=1e-6)


def test_a_triangle_without_area_has_no_normal_and_a_finite_gradient():
    vertices = jnp.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    faces = jnp.array([[0, 1, 2], [1, 1, 1]])
    np.testing.assert_array_equal(face_normals(vertices, faces), 0.0)
    for function in (face_normals, vertex_normals):
        assert np.isfinite(jax.grad(lambda v, f=function: f(v, faces).sum())(vertices)).all()


def test_corner_angles_sum_to_pi_and_are_zero_at_a_collapsed_edge():
    corners = jnp.array(np.random.default_rng(0).normal(size=(50, 3, 3)), jnp.float32)
    np.testing.assert_allclose(corner_angles(corners).sum(axis=1), np.pi, rtol=1e-5)
    right = jnp.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    np.testing.assert_allclose(corner_angles(right), [[np.pi / 2, np.pi / 4, np.pi / 4]], rtol=1e-6)
    assert np.isfinite(corner_angles(jnp.zeros((1, 3, 3)))).all()


def test_vertex_normals_do_not_depend_on_how_a_flat_face_is_cut():
    vertices, faces = box((0.3, 0.3, 0.3))
    normals = vertex_normals(jnp.asarray(vertices, jnp.float32), jnp.asarray(faces))
    np.testing.assert_allclose(normals, vertices / np.linalg.norm(vertices, axis=1)[:, None], atol=1e-6)


def test_vertex_normals_of_a_sphere_point_outward():
    vertices, faces = sphere(0.3, 3)
    normals = vertex_normals(jnp.asarray(vertices, jnp.float32), jnp.asarray(faces))
    assert ((normals * vertices / 0.3).sum(axis=1) > 0.998).all()
