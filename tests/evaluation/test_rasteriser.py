import numpy as np

from garment_jax.evaluation.camera import look_at, project, rays, view_direction
from garment_jax.evaluation.rasteriser import rasterise


def _naive(xy, nearness, faces, height, width):
    """Every pixel against every triangle."""
    face = np.full((height, width), -1)
    depth = np.full((height, width), -np.inf)
    for f, (a, b, c) in enumerate(faces):
        matrix = np.vstack([xy[[a, b, c]].T, np.ones(3)])
        if abs(np.linalg.det(matrix)) < 1e-9:
            continue
        for y in range(height):
            for x in range(width):
                w = np.linalg.solve(matrix, [x + 0.5, y + 0.5, 1.0])
                near = w @ nearness[[a, b, c]]
                if (w >= 0).all() and near > depth[y, x]:
                    face[y, x], depth[y, x] = f, near
    return face, depth


def test_equals_every_pixel_against_every_triangle():
    rng = np.random.default_rng(8)
    xy = rng.uniform(-5, 25, (40, 2))  # some reach beyond the picture
    nearness, faces = rng.uniform(1, 2, 40), rng.integers(0, 40, (30, 3))
    seen = rasterise(xy, nearness, faces, height=18, width=22)
    face, depth = _naive(xy, nearness, faces, 18, 22)
    np.testing.assert_array_equal(seen.face, face)
    np.testing.assert_allclose(seen.nearness, depth, rtol=1e-5)
    at = face >= 0
    np.testing.assert_allclose(seen.weights[at].sum(axis=1), 1.0, atol=1e-5)
    assert (seen.weights[~at] == 0).all()


def test_nothing_in_view_is_an_empty_picture():
    seen = rasterise(np.full((3, 2), -9.0), np.ones(3), np.array([[0, 1, 2]]), height=4, width=4)
    assert (seen.face == -1).all()


def test_the_target_is_in_the_middle_and_the_span_fills_the_height():
    target = np.array([1.0, 0.8, -2.0])
    camera = look_at(target, np.array([0.0, 0.0, 1.0]), span=2.0, height=100, width=60)
    xy, near = project(target + np.array([[0, 0, 0], [0, 1, 0], [0.3, 0, 0]]), camera)
    np.testing.assert_allclose(xy, [[30, 50], [30, 0], [45, 50]], atol=1e-9)
    assert near[0] > 0


def test_rays_pass_through_what_projects_to_their_pixel():
    camera = look_at(np.zeros(3), view_direction(0.7, azimuth=35), span=2.0, height=20, width=30)
    points = camera.position + 3.0 * rays(camera)
    xy, _ = project(points.reshape(-1, 3), camera)
    x, y = np.meshgrid(np.arange(30) + 0.5, np.arange(20) + 0.5)
    np.testing.assert_allclose(xy, np.stack([x.ravel(), y.ravel()], axis=1), atol=1e-9)


def test_azimuth_turns_from_the_front_to_the_left_side():
    np.testing.assert_allclose(view_direction(0.0, azimuth=0, elevation=0), [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(view_direction(0.0, azimuth=90, elevation=0), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(view_direction(np.pi / 2, azimuth=0, elevation=0), [1, 0, 0], atol=1e-12)
