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
    assert self_intersections(crumpled, garment.faces).edges == expected


def test_a_smooth_garment_has_none_and_pierced_triangles_count():
    garment = make_scene().garment
    assert self_intersections(garment.template, garment.faces).edges == 0
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    V = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [0.2, -1, 0.2], [0.2, 1, 0.2], [5, 1, 5]], float)
    found = self_intersections(V, faces)
    assert found.vertices.all()
    assert found.edges == 2 == _naive(V, faces)  # each triangle's edge in the other
    V[4] = [0.2, 0.0, 0.2]  # touches: its end lies on the triangle
    V[5] = [0.3, -1, 0.2]
    assert self_intersections(V, faces).edges == 0


def test_the_area_is_that_of_what_went_through():
    """A cone through a sheet: its tip, and the disc of the sheet that is inside the cone."""
    side, count = 1.0, 61
    x, z = np.meshgrid(*[np.linspace(-side / 2, side / 2, count)] * 2, indexing="ij")
    k = np.arange(count**2).reshape(count, count)
    a, b, c, d = (corner.ravel() for corner in (k[:-1, :-1], k[1:, :-1], k[:-1, 1:], k[1:, 1:]))
    sheet = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])
    cone = 0.4 - 1.5 * np.hypot(x, z)
    height, level = np.stack([np.full_like(x, 0.1013), cone]), 0.1013
    V = np.stack([np.broadcast_to(x, height.shape), height, np.broadcast_to(z, height.shape)], -1).reshape(
        -1, 3
    )
    V += [1e-3, 0.0, 2e-3] * (np.arange(len(V)) < count**2)[:, None]  # no edge meets an edge
    found = self_intersections(V, np.concatenate([sheet, sheet + count**2]))
    radius = (0.4 - level) / 1.5
    tip = np.pi * radius * np.hypot(radius, 0.4 - level)
    assert abs(found.area_cm2 / 1e4 / (tip + np.pi * radius**2) - 1) < 0.03
    assert self_intersections(V[count**2 :], sheet).area_cm2 == 0


def test_cloth_that_goes_through_two_sheets_is_back_on_its_side():
    """A strip 5 cm wide and 3 m long: through one sheet, one of its ends is on the other side."""
    strip = [[0.2, -1, 0.2], [0.25, -1, 0.2], [0.2, 2, 0.2], [0.25, 2, 0.2]]
    sheets = [[0, y, 0] for y in (0, 1)], [[1, y, 0] for y in (0, 1)], [[0, y, 1] for y in (0, 1)]
    V = np.array([*strip, *(corner for three in zip(*sheets, strict=True) for corner in three)], float)
    faces = np.array([[0, 1, 2], [1, 3, 2], [4, 5, 6], [7, 8, 9]])
    np.testing.assert_allclose(self_intersections(V, faces[:3]).area_cm2, 1e4 * 0.05 * 3 / 2)
    through_two = self_intersections(V, faces)
    assert through_two.edges == 3
    assert through_two.area_cm2 == 0
