"""Short waves of a sheet go, long ones and what is affine in it stay, and borders are not drawn inwards."""

import jax
import numpy as np

from garment_jax.geometry.low_pass import low_pass, make_low_pass
from tests.postprocess.sheets import EDGE, FACES, SIDE, T

LENGTH = EDGE * (SIDE - 1)
TABLES = make_low_pass(T, FACES, (0.02, 0.05))
passed = jax.jit(lambda V: low_pass(V, TABLES))


def wave(length: float) -> np.ndarray:
    """The sheet with waves of 1 cm along x, of which a whole number of halves fits."""
    V = T.copy()
    V[:, 1] = 0.01 * np.cos(2 * np.pi * T[:, 0] / length)
    return V


def test_a_flat_sheet_turned_stretched_and_moved_stays():
    V = (T @ np.float32([[0.9, 0.1, 0.3], [0.2, 1.1, 0.1], [-0.3, 0.2, 0.8]]) + 2).astype(np.float32)
    for flat in passed(V):
        assert np.abs(flat - V).max() < 2e-6


def test_a_wave_keeps_what_its_gain_says():
    for halves in (2, 4, 8):
        V = wave(2 * LENGTH / halves)
        # a mode of the Laplacian of a free sheet of squares, and its eigenvalue
        square = (2 - 2 * np.cos(np.pi * halves / LENGTH * EDGE)) / EDGE**2
        for reach, flat in zip((0.02, 0.05), passed(V), strict=True):
            gain = np.exp(-((square * reach**2 / 2) ** 2))
            kept = np.asarray(flat)[:, 1] @ V[:, 1] / (V[:, 1] @ V[:, 1])
            assert abs(kept - gain) < 0.01, (halves, reach)


def test_all_modes_of_a_small_mesh_are_there():
    corner = (T[:, 0] < 3.5 * EDGE) & (T[:, 2] < 3.5 * EDGE)
    number = np.cumsum(corner) - 1
    faces = number[FACES[corner[FACES].all(axis=1)]].astype(np.int32)
    tables = make_low_pass(T[corner], faces, (1e-4,))
    V = jax.random.normal(jax.random.key(0), (16, 3))
    assert tables.modes.shape == (16, 16)
    assert np.abs(low_pass(V, tables)[0] - V).max() < 1e-4


def test_vertices_without_faces_and_the_same_tables_every_time():
    lonely = np.concatenate([T, T[:2] + 1])
    one, two = (make_low_pass(lonely, FACES, (0.05,)) for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))
    assert np.isfinite(low_pass(jax.numpy.asarray(lonely), one)[0]).all()
