import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.evaluation import cloth
from garment_jax.geometry.boundary import boundary_edges
from garment_jax.geometry.laplacian import laplacian, uniform_table
from garment_jax.geometry.topology import unique_edges
from tests.reference.scene import make_scene


def _ridges(k=40, waves=8.0, height=0.01):
    """A flat sheet of k x k vertices, 1 cm apart, with `waves` ridges across it; faces too."""
    i, j = np.meshgrid(np.arange(k), np.arange(k))
    y = height * np.sin(2 * np.pi * waves * i / (k - 1))
    vertices = np.stack([0.01 * i, y, 0.01 * j], axis=-1).reshape(-1, 3)
    at = np.arange(k * k).reshape(k, k)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[:-1, 1:].ravel(), at[1:, 1:].ravel()
    return vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([c, b, d], 1)])


def test_hem_worked_by_hand():
    positions = np.zeros((4, 2, 3))
    positions[:, :, 1] = np.array([-0.30, -0.32, -0.30, -0.32])[:, None]
    positions[:, 0, 0] = [0.05, -0.05, 0.05, -0.05]
    figures = cloth.hem(positions)
    assert figures.height_cm == pytest.approx(-31.0)
    assert figures.height_std_cm == pytest.approx(1.0)
    assert figures.motion_std_cm == pytest.approx(np.sqrt((1 + 25 + 1) / 2))


def test_strain_of_a_scaled_template_is_the_scale():
    garment = make_scene().garment
    edges = unique_edges(garment.faces)
    rest = cloth.rest_lengths(garment.template, edges)
    V = np.stack([garment.template * 1.02, garment.template * 0.95])
    figures = cloth.strain(V, edges, rest)
    np.testing.assert_allclose(figures, [3.5, 3.5, 5.0], rtol=1e-3)


def test_an_edge_without_length_is_refused():
    with pytest.raises(ValueError, match="edge 0-1 has no length"):
        cloth.rest_lengths(np.zeros((2, 3)), np.array([[0, 1]]))


def test_power_uses_the_house_laplacian_over_interior_vertices():
    V, faces = _ridges()
    spectrum = cloth.make_spectrum(faces, len(V))
    L = np.asarray(laplacian(jnp.asarray(100 * V, jnp.float32), uniform_table(faces, len(V))))
    square = (L.astype(np.float64) ** 2).sum(axis=1)
    inner = np.setdiff1d(np.arange(len(V)), boundary_edges(faces))
    np.testing.assert_array_equal(spectrum.interior, inner)
    assert cloth.laplacian_power(V[None], spectrum)[0] == pytest.approx(square[inner].mean(), rel=1e-3)
    assert cloth.whole_laplacian_power(V[None], spectrum)[0] == pytest.approx(square.mean(), rel=1e-3)


def test_power_grows_with_the_square_of_the_folds_and_is_blind_to_none():
    spectrum = cloth.make_spectrum(_ridges()[1], 1600)
    flat, low, high = (
        cloth.laplacian_power(_ridges(height=h)[0][None], spectrum)[0] for h in (0, 0.01, 0.02)
    )
    assert flat == pytest.approx(0.0, abs=1e-12)
    assert high == pytest.approx(4 * low)
    whole = cloth.whole_laplacian_power(_ridges(height=0)[0][None], spectrum)[0]
    assert whole > 0.01  # a flat sheet's border alone: the reason why it is left out


def test_narrow_folds_fall_into_finer_bands_than_wide_ones():
    _, faces = _ridges()
    spectrum = cloth.make_spectrum(faces, 1600)
    strongest = []
    for waves in (16.0, 8.0, 5.0, 2.0):
        bands = cloth.band_power(_ridges(waves=waves)[0][None], spectrum)[:, 0]
        strongest.append(int(np.argmax(bands)))
    assert strongest == sorted(strongest)
    assert strongest[0] == 0
    assert strongest[-1] == 4


def test_figures_do_not_change_under_a_rigid_motion():
    V, faces = _ridges()
    spectrum = cloth.make_spectrum(faces, len(V))
    c, s = np.cos(2.4), np.sin(2.4)
    moved = V @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + [5.0, 0, -3.0]
    np.testing.assert_allclose(cloth.band_power(moved[None], spectrum), cloth.band_power(V[None], spectrum))


def test_a_strip_that_is_all_boundary_has_no_folds_to_measure():
    faces = np.array([[0, 1, 2], [2, 1, 3]])
    spectrum = cloth.make_spectrum(faces, 4)
    V = np.random.default_rng(0).normal(size=(3, 4, 3))
    np.testing.assert_array_equal(cloth.laplacian_power(V, spectrum), np.zeros(3))
    np.testing.assert_array_equal(cloth.band_power(V, spectrum), np.zeros((5, 3)))
