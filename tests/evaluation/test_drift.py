import numpy as np
import pytest

from garment_jax.evaluation.drift import drift, skinned_template, skinning_weights, thirds_ratio
from tests.reference.scene import make_motion, make_scene, skin


def test_thirds_worked_by_hand():
    assert thirds_ratio(np.array([1.0, 1.0, 9.0, 9.0, 2.0, 2.0])) == pytest.approx(2.0)
    assert thirds_ratio(np.array([3.0, 4.0, 9.0, 0.0, 5.0])) == pytest.approx(5 / 3)
    assert thirds_ratio(np.zeros(6)) == 1.0
    assert thirds_ratio(np.array([0.0, 1.0, 1.0])) == np.inf


def test_drift_is_relative_to_the_model_without_memory():
    harder = np.array([1.0, 1.5, 2.0])
    assert drift(3 * harder, harder) == pytest.approx(1.0)
    assert drift(np.array([1.0, 1.0, 4.0]), harder) == pytest.approx(2.0)
    assert drift(np.array([1.0, 1.0, 1.0]), np.array([1.0, 0.0, 0.0])) == np.inf


def test_too_short_a_clip_is_refused():
    with pytest.raises(ValueError, match="not 2"):
        thirds_ratio(np.ones(2))


def test_skinned_template_equals_the_reference_and_pins_keep_their_weights():
    scene = make_scene()
    motion = make_motion(scene, 6)
    weights = skinning_weights(scene)
    np.testing.assert_array_equal(weights[scene.pins.vertices], scene.pins.weights)
    expected = skin(scene.garment.template.astype(np.float64), weights, motion, scene.body)
    got = skinned_template(scene, motion, weights, slice(2, 5))
    np.testing.assert_allclose(got, expected[2:5], atol=1e-5)
    free = skinning_weights(scene._replace(pins=None))
    nearest = np.linalg.norm(scene.body.vertices - scene.garment.template[-1], axis=1).argmin()
    np.testing.assert_array_equal(free[-1], scene.body.skin_weights[nearest])
