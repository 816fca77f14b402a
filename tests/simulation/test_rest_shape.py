"""The rest shape has the template's lengths, counter-clockwise, from whichever source."""

import numpy as np
import pytest

from garment_jax.simulation.rest_shape import rest_shape
from garment_jax.structs import Garment
from tests.reference.scene import make_scene

SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def lengths(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Edge lengths, one edge at a time."""
    return np.array([[np.linalg.norm(points[f[i]] - points[f[i - 1]]) for i in range(3)] for f in faces])


def areas(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    return np.array(
        [0.5 * np.linalg.det([points[b] - points[a], points[c] - points[a]]) for a, b, c in faces]
    )


def bent(uv: np.ndarray) -> Garment:
    """Half a metre of cloth, folded along the diagonal of its square."""
    x = np.array([[0, 0, 0], [0.5, 0, 0], [0.5, 0.5, 0], [0.25, 0.25, np.hypot(0.25, 0.25)]], np.float32)
    return Garment(x, FACES, uv.astype(np.float32), FACES)


def test_uvs_that_are_the_pattern_are_scaled_to_metres():
    garment = bent(0.2 + 0.6 * SQUARE)
    points, faces = rest_shape(garment)
    assert len(points) == 4
    np.testing.assert_allclose(lengths(points, faces), lengths(garment.template, FACES), rtol=1e-5)
    assert (areas(points, faces) > 0).all()


def test_mirrored_uvs_are_turned_over():
    points, faces = rest_shape(bent(SQUARE[:, ::-1]))
    assert len(points) == 4
    np.testing.assert_allclose(areas(points, faces), 0.125, rtol=1e-5)


def test_charts_have_their_own_scale_and_sense():
    """Two triangles that share two vertices, cut apart in the UVs: one small, one mirrored."""
    uv = np.concatenate([0.1 * SQUARE[[0, 1, 2]], (0.7 * SQUARE[[0, 2, 3]])[:, ::-1]])
    garment = bent(SQUARE)._replace(uv=uv, faces_uv=np.arange(6, dtype=np.int32).reshape(2, 3))
    points, faces = rest_shape(garment)
    assert len(points) == 6
    np.testing.assert_allclose(areas(points, faces), 0.125, rtol=1e-5)


def test_uvs_that_are_no_pattern_give_each_triangle_its_own_shape():
    garment = make_scene().garment  # a cone whose UVs are a rectangle
    points, faces = rest_shape(garment)
    assert len(points) == 3 * len(garment.faces)
    np.testing.assert_allclose(lengths(points, faces), lengths(garment.template, garment.faces), rtol=1e-4)
    assert (areas(points, faces) > 0).all()


def test_unfolded_triangles_run_along_the_uvs():
    """Stretched by a half in u: not isometric, and the threads keep the axes of the UVs."""
    uv = SQUARE * [1.5, 1.0]
    points, faces = rest_shape(bent(uv))
    assert len(points) == 6
    flat = (0.5 * SQUARE)[FACES]
    np.testing.assert_allclose(points[faces] - points[faces][:, :1], flat - flat[:, :1], atol=0.06)


def test_the_given_pattern_wins():
    garment = bent(SQUARE * [1.5, 1.0])
    points, faces = rest_shape(garment, 0.55 * SQUARE)
    np.testing.assert_allclose(points, 0.55 * SQUARE, rtol=1e-6)
    np.testing.assert_array_equal(faces, FACES)


@pytest.mark.parametrize(
    ("flat", "match"),
    [
        (SQUARE[:3], r"shape \(3, 2\), the garment's UVs \(4, 2\)"),
        (50 * SQUARE, "100 times the template's; give it in metres"),
        (0.5 * np.array([[0, 0], [1, 0], [1, 1], [0.5, 0.1]]), "turns face 1 over"),
    ],
)
def test_a_pattern_that_cannot_be_it_is_refused(flat: np.ndarray, match: str):
    with pytest.raises(ValueError, match=match):
        rest_shape(bent(SQUARE), flat)


def test_a_face_without_area_is_refused():
    garment = bent(SQUARE * [1.5, 1.0])
    garment.template[3] = garment.template[2]
    with pytest.raises(ValueError, match="face 1 of the template has no area"):
        rest_shape(garment)


def test_the_shared_pattern_is_the_shared_template(shared_data):
    h5py = pytest.importorskip("h5py")
    with h5py.File(shared_data / "skirt" / "train_salsa_02.h5") as file:
        garment = Garment(*(file[name][()] for name in ("template", "faces", "uv", "faces_uv")))
        flat = file["rest_uv_metres"][()]
    points, faces = rest_shape(garment, flat)
    assert (areas(points, faces) > 0).all()
    # the template's waist follows the body, where it is strained by up to 7 per cent
    np.testing.assert_allclose(lengths(points, faces), lengths(garment.template, garment.faces), rtol=0.08)
    assert len(rest_shape(garment)[0]) == 3 * len(garment.faces)  # its UVs are a rectangle
    # the same pattern as UVs (one scale for both axes, mirrored) is found again
    uv = (flat - flat.min(axis=0)) / np.ptp(flat, axis=0).max() * [-1, 1] + [1, 0]
    found, _ = rest_shape(garment._replace(uv=uv.astype(np.float32)))
    np.testing.assert_allclose(lengths(found, faces), lengths(points, faces), rtol=0.01)
