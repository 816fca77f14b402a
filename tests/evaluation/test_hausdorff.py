import numpy as np
import pytest
import trimesh

from garment_jax.evaluation.hausdorff import hausdorff, hausdorff_frame
from garment_jax.evaluation.rmse import vertex_distance


def _sheet(k=6):
    x, z = np.meshgrid(np.linspace(0, 1, k), np.linspace(0, 1, k))
    vertices = np.stack([x.ravel(), np.zeros(k * k), z.ravel()], axis=1)
    i = np.arange(k * k).reshape(k, k)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel()
    return vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([c, b, d], 1)])


def test_a_sheet_slid_within_its_plane_is_only_as_far_as_it_sticks_out():
    vertices, faces = _sheet()
    assert hausdorff_frame(vertices + np.array([0.13, 0, 0]), vertices, faces) == pytest.approx(13.0)
    raised = vertices + np.array([0.0, 0.02, 0])
    assert hausdorff_frame(raised, vertices, faces) == pytest.approx(2.0)


def test_a_vertex_over_a_triangle_is_measured_to_the_surface_not_to_a_vertex():
    vertices, faces = _sheet(3)  # vertices half a metre apart
    moved = vertices + np.array([0.2, 0.01, 0.0])
    assert hausdorff_frame(moved, vertices, faces) < 100 * np.sqrt(0.2**2 + 0.01**2) + 1e-9
    inner = vertices.copy()
    inner[4] += [0.1, 0.0, 0.1]  # the middle vertex slides along the sheet
    assert hausdorff_frame(inner, vertices, faces) == pytest.approx(0.0, abs=1e-9)


def test_equals_a_brute_force_by_trimesh_and_is_symmetric():
    rng = np.random.default_rng(3)
    vertices, faces = _sheet(5)
    a, b = vertices + 0.05 * rng.normal(size=(2, *vertices.shape))

    def one_side(points, corners):
        at = [trimesh.triangles.closest_point(corners, np.tile(p, (len(corners), 1))) for p in points]
        return max(np.linalg.norm(q - p, axis=1).min() for p, q in zip(points, at, strict=True))

    expected = 100 * max(one_side(a, b[faces]), one_side(b, a[faces]))
    assert hausdorff_frame(a, b, faces) == pytest.approx(expected)
    assert hausdorff_frame(b, a, faces) == pytest.approx(expected)
    assert expected <= vertex_distance(a[None], b[None]).max() + 1e-9


def test_the_clip_is_the_mean_over_sampled_frames():
    vertices, faces = _sheet(4)
    V_star = np.tile(vertices, (4, 1, 1))
    V = V_star + np.array([0.01, 0.02, 0.03, 0.04])[:, None, None] * [0, 1, 0]
    assert hausdorff(V, V_star, faces) == pytest.approx(2.5)
    assert hausdorff(V, V_star, faces, every=2) == pytest.approx(2.0)
    with pytest.raises(ValueError, match="--every 0"):
        hausdorff(V, V_star, faces, every=0)
