import jax.numpy as jnp
import numpy as np

from garment_jax.geometry.uv_atlas import make_atlas
from garment_jax.geometry.uv_maps import from_map, to_map
from garment_jax.structs import Garment
from tests.reference.scene import make_scene


def flat_sheet(size: int = 4) -> Garment:
    """A sheet without a seam whose UVs are its positions."""
    x, y = np.meshgrid(np.arange(size) / (size - 1), np.arange(size) / (size - 1))
    uv = np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float32)
    faces = []
    for row in range(size - 1):
        for column in range(size - 1):
            a = row * size + column
            faces += [(a, a + 1, a + size + 1), (a, a + size + 1, a + size)]
    template = np.concatenate([uv, np.zeros((len(uv), 1), np.float32)], axis=1)
    return Garment(template, np.array(faces, np.int32), uv, np.array(faces, np.int32))


def test_a_linear_function_of_uv_survives_the_round_trip():
    garment = flat_sheet()
    atlas = make_atlas(garment, 16)
    linear = jnp.asarray(garment.uv @ np.array([[2.0, -1, 0.5], [1, 3, 0]], np.float32) + np.float32(0.7))
    np.testing.assert_allclose(from_map(to_map(linear, atlas), atlas), linear, atol=1e-5)


def test_the_map_of_a_linear_function_is_linear_in_the_texels():
    garment = flat_sheet()
    S = to_map(jnp.asarray(garment.uv), make_atlas(garment, 16))
    row, column = np.indices((16, 16)) / 15
    np.testing.assert_allclose(S, np.stack([column, row], axis=-1), atol=1e-6)


def test_a_seam_vertex_reads_the_mean_of_its_two_places():
    garment = make_scene(5, 8).garment
    atlas = make_atlas(garment, 16)
    column = jnp.broadcast_to(jnp.arange(16.0)[None, :, None], (16, 16, 1))
    read = from_map(column, atlas)[:, 0].reshape(5, 8)
    np.testing.assert_allclose(read[:, 0], 7.5, atol=1e-5)  # u = 0 and u = 1
    np.testing.assert_allclose(read[0], [7.5, *(15 * np.arange(1, 8) / 8)], atol=1e-5)


def test_a_constant_survives_exactly_enough_and_the_error_of_a_round_trip_shrinks_with_the_map():
    garment = make_scene(5, 8).garment
    V = jnp.asarray(garment.template)
    errors = []
    for size in (16, 64):
        atlas = make_atlas(garment, size)
        np.testing.assert_allclose(from_map(to_map(jnp.ones_like(V), atlas), atlas), 1, atol=1e-6)
        errors.append(float(np.abs(from_map(to_map(V, atlas), atlas) - V).max()))
    assert errors[1] < 0.5 * errors[0]


def test_a_batch_is_one_by_one():
    garment = make_scene(5, 8).garment
    atlas = make_atlas(garment, 16)
    V = jnp.asarray(np.random.default_rng(0).normal(size=(2, 3, len(garment.template), 3)), jnp.float32)
    S = to_map(V, atlas)
    assert S.shape == (2, 3, 16, 16, 3)
    np.testing.assert_allclose(S[1, 2], to_map(V[1, 2], atlas), atol=1e-6)
    np.testing.assert_allclose(from_map(S, atlas)[1, 2], from_map(S[1, 2], atlas), atol=1e-6)
