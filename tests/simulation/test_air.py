"""The drag of one face by hand, its limit, and the conservation of momentum."""

import numpy as np
import pytest

from garment_jax.simulation.air import Air, drag_velocities, make_air
from garment_jax.simulation.settings import ClothSettings

CORNERS = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0]], np.float32)  # half a square metre, normal +Y


def one_face(cloth_density: float = 0.2) -> Air:
    return make_air(np.array([[0, 1, 2]]), np.array([0.5]), 4, ClothSettings(density=cloth_density))


def test_a_face_feels_half_rho_c_area_times_speed_squared():
    v = np.array([[3.0, -2.0, 0.0]] * 3 + [[0, -2, 0]], np.float32)
    change = drag_velocities(one_face(), np.vstack([CORNERS, CORNERS[:1]]), v, 1e-3)
    # force 1/2 * 1.2 * 1.2 * 0.5 m2 * 4 m2/s2 = 1.44 N on 0.1 kg, for a millisecond, against the fall
    np.testing.assert_allclose(change[:3], [[0.0, 0.0144, 0.0]] * 3, rtol=1e-5)
    np.testing.assert_array_equal(change[3], 0.0)  # belongs to no face


@pytest.mark.parametrize("speed", [-50.0, 50.0])
def test_it_stops_a_face_but_never_sends_it_back(speed: float):
    v = np.tile(np.array([[1.0, speed, 0.0]], np.float32), (4, 1))
    after = v + drag_velocities(one_face(), np.vstack([CORNERS, CORNERS[:1]]), v, 1.0)
    np.testing.assert_allclose(after[:3], [[1.0, 0.0, 0.0]] * 3, atol=1e-4)


def test_a_folded_sheet_loses_what_its_faces_feel():
    rng = np.random.default_rng(0)
    x, v = (rng.normal(size=(5, 3)).astype(np.float32) for _ in range(2))
    faces = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4]])
    a, b, c = x.astype(np.float64)[faces].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1) / 2
    air = make_air(faces, area, 5, ClothSettings(density=0.3))
    w = (v[faces].mean(axis=1) * normal).sum(axis=1) / (2 * area)
    impulse = 1e-4 * -0.72 * (area * np.abs(w) * w)[:, None] * normal / (2 * area)[:, None]
    mass = np.zeros(5)
    np.add.at(mass, faces, 0.1 * area[:, None])
    change = drag_velocities(air, x, v, 1e-4)
    np.testing.assert_allclose((mass[:, None] * change).sum(axis=0), impulse.sum(axis=0), rtol=1e-3)
    np.testing.assert_allclose(change[4], impulse[2] / (0.3 * area[2]), rtol=1e-4)  # in the last face only


def test_a_face_without_area_feels_nothing():
    v = np.ones((4, 3), np.float32)
    assert not drag_velocities(one_face(), np.zeros((4, 3), np.float32), v, 1e-3).any()
