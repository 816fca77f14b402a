"""The garment at its pins: there exactly, the neighbours along, nothing moved that was right."""

import jax.numpy as jnp
import numpy as np

from garment_jax.evaluation.cloth import rest_lengths
from garment_jax.geometry.topology import unique_edges
from garment_jax.rollout.attachment import make_attachment
from tests.reference.scene import make_scene

SCENE = make_scene()
assert SCENE.pins is not None
PINS = SCENE.pins.vertices
T = SCENE.garment.template


def test_pins_are_where_they_belong_and_a_right_garment_stays():
    attach = make_attachment(SCENE.garment, PINS)
    moved = T[PINS] + np.array([0.03, 0.0, 0.01], np.float32)
    np.testing.assert_array_equal(attach(jnp.asarray(T), jnp.asarray(moved))[PINS], moved)
    np.testing.assert_allclose(attach(jnp.asarray(T), jnp.asarray(T[PINS])), T, atol=1e-7)


def test_the_cloth_beside_the_pins_is_torn_less_than_by_the_pins_alone():
    edges = unique_edges(SCENE.garment.faces)
    rest = rest_lengths(T, edges)
    moved = T[PINS] + np.array([0.1, 0.0, 0.0], np.float32)

    def stretch(V: np.ndarray) -> float:
        return float((np.linalg.norm(V[edges[:, 1]] - V[edges[:, 0]], axis=1) / rest).max()) - 1.0

    alone = T.copy()
    alone[PINS] = moved
    attached = np.asarray(make_attachment(SCENE.garment, PINS)(jnp.asarray(T), jnp.asarray(moved)))
    assert stretch(attached) < 0.5 * stretch(alone)


def test_frames_are_taken_at_once_and_without_pins_nothing_happens():
    attach = make_attachment(SCENE.garment, PINS)
    V = jnp.asarray(np.stack([T, T + 0.01]))
    positions = jnp.asarray(np.stack([T[PINS] + 0.02, T[PINS]]))
    each = np.stack([attach(v, p) for v, p in zip(V, positions, strict=True)])
    np.testing.assert_allclose(attach(V, positions), each, atol=1e-6)
    nothing = make_attachment(SCENE.garment, np.zeros(0, np.int32))
    assert nothing(V, jnp.zeros((2, 0, 3))) is V
