import numpy as np
import pytest

from garment_jax.geometry.symmetry import mirror_permutation
from tests.reference.scene import make_scene

GARMENT = make_scene(5, 8).garment
FLIP = np.array([-1, 1, 1], np.float32)


def shuffled(garment, seed=0):
    """The same garment with its vertices in another order; nothing may rely on the grid."""
    order = np.random.default_rng(seed).permutation(len(garment.template))
    place = np.argsort(order)
    return garment._replace(template=garment.template[order], faces=place[garment.faces].astype(np.int32))


@pytest.mark.parametrize("garment", [GARMENT, shuffled(GARMENT)], ids=["grid", "shuffled"])
def test_partners_are_mirror_images_and_mirroring_twice_is_the_identity(garment):
    p = mirror_permutation(garment)
    np.testing.assert_array_equal(p[p], np.arange(len(p)))
    np.testing.assert_allclose(garment.template[p], garment.template * FLIP, atol=1e-6)


def test_uvs_without_symmetry_leave_the_nearest_mirrored_vertices():
    garment = GARMENT._replace(uv=GARMENT.uv * np.array([0.7, 1], np.float32))
    p = mirror_permutation(garment)
    np.testing.assert_allclose(garment.template[p], garment.template * FLIP, atol=1e-6)


def test_a_garment_that_hangs_to_one_side_is_refused():
    moved = GARMENT._replace(template=GARMENT.template + np.array([0.1, 0, 0], np.float32))
    with pytest.raises(ValueError, match=r"not left-right symmetric.*cm.*data\.mirror = false"):
        mirror_permutation(moved)
