import numpy as np

from garment_jax.evaluation.self_intersections import self_intersections
from garment_jax.geometry.topology import unique_edges
from tests.reference.scene import make_scene


def _naive(V, faces):
    """Every edge against every triangle: solve for the crossing, one pair at a time."""
    crossing = 0
    for i, j in unique_edges(faces):
        for f in faces:
            if i in f or j in f:
                continue
            a, b, c = V[f]
            matrix = np.stack([V[j] - V[i], a - b, a - c], axis=1)
            if abs(np.linalg.det(matrix)) < 1e-15:
                continue
            s, beta, gamma = np.linalg.solve(matrix, a - V[i])
            if 0 < s < 1 and beta > 0 and gamma > 0 and beta + gamma < 1:
                crossing += 1
                break
    return crossing


def test_equals_the_naive_loop_on_a_crumpled_skirt():
    garment = make_scene(rings=5, columns=10).garment
    rng = np.random.default_rng(6)
    crumpled = garment.template.astype(np.float64) + 0.25 * rng.normal(size=garment.template.shape)
    expected = _naive(crumpled, garment.faces)
    assert expected > 20
    assert self_intersections(crumpled, garment.faces) == expected


def test_a_smooth_garment_has_none_and_pierced_triangles_count():
    garment = make_scene().garment
    assert self_intersections(garment.template, garment.faces) == 0
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    V = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [0.2, -1, 0.2], [0.2, 1, 0.2], [5, 1, 5]], float)
    assert self_intersections(V, faces) == 2 == _naive(V, faces)  # each triangle's edge in the other
    V[4] = [0.2, 0.0, 0.2]  # touches: its end lies on the triangle
    V[5] = [0.3, -1, 0.2]
    assert self_intersections(V, faces) == 0
