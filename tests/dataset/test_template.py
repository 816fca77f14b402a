import numpy as np
import pytest

from garment_jax.dataset.template import Statistics, make_template
from tests.reference.laplacian import cotangent_weights, one_rings
from tests.reference.scene import make_scene

SCENE = make_scene(4, 8)
STATISTICS = Statistics(*(np.zeros(3, np.float32) for _ in Statistics._fields))


def test_the_template_has_its_origin_at_the_canonical_root_joint():
    template = make_template(SCENE.garment, SCENE.body, STATISTICS, uv_size=16)
    np.testing.assert_allclose(template.T + SCENE.body.joints[0], SCENE.garment.template, atol=1e-6)
    assert template.T.dtype == np.float32
    assert template.atlas.coverage.shape == (16, 16)
    assert template.statistics is STATISTICS


def test_the_laplacian_is_uniform_unless_cotangent_is_asked_for():
    uniform = make_template(SCENE.garment, SCENE.body, STATISTICS, uv_size=16).laplacian
    valence = [len(ring) for ring in one_rings(SCENE.garment.faces, len(SCENE.garment.template))]
    np.testing.assert_allclose(uniform.weight.max(axis=1), 1 / np.array(valence), rtol=1e-6)
    cotangent = make_template(
        SCENE.garment, SCENE.body, STATISTICS, uv_size=16, laplacian="cotangent"
    ).laplacian
    expected = cotangent_weights(SCENE.garment.template.astype(float), SCENE.garment.faces)
    np.testing.assert_allclose(cotangent.weight.max(axis=1), expected.max(axis=1), atol=1e-5)


def test_what_the_atlas_refuses_is_refused_here():
    garment = SCENE.garment._replace(uv=SCENE.garment.uv * 2)
    with pytest.raises(ValueError, match="UVs span"):
        make_template(garment, SCENE.body, STATISTICS, uv_size=16)
