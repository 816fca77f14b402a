"""The garment at its pins: there exactly, the neighbours along, nothing moved that was right."""

import jax.numpy as jnp
import numpy as np

from garment_jax.evaluation.cloth import rest_lengths
from garment_jax.geometry.topology import unique_edges
from garment_jax.postprocess.pins import attach, pin_extension
from tests.reference.scene import make_scene

SCENE = make_scene()
assert SCENE.pins is not None
PINS = SCENE.pins.vertices
T = SCENE.garment.template
EXTENSION = pin_extension(SCENE.garment, PINS)


def attached(V, positions) -> np.ndarray:
    return np.asarray(attach(jnp.asarray(V), jnp.asarray(positions), pins=PINS, extension=EXTENSION))


def test_pins_are_where_they_belong_and_a_right_garment_stays():
    moved = T[PINS] + np.array([0.03, 0.0, 0.01], np.float32)
    np.testing.assert_array_equal(attached(T, moved)[PINS], moved)
    np.testing.assert_allclose(attached(T, T[PINS]), T, atol=1e-7)


def test_the_cloth_beside_the_pins_is_torn_less_than_by_the_pins_alone():
    edges = unique_edges(SCENE.garment.faces)
    rest = rest_lengths(T, edges)
    moved = T[PINS] + np.array([0.1, 0.0, 0.0], np.float32)

    def stretch(V: np.ndarray) -> float:
        return float((np.linalg.norm(V[edges[:, 1]] - V[edges[:, 0]], axis=1) / rest).max()) - 1.0

    alone = T.copy()
    alone[PINS] = moved
    assert stretch(attached(T, moved)) < 0.5 * stretch(alone)


def test_frames_are_taken_at_once_and_without_pins_nothing_happens():
    V = np.stack([T, T + 0.01])
    positions = np.stack([T[PINS] + 0.02, T[PINS]])
    each = np.stack([attached(v, p) for v, p in zip(V, positions, strict=True)])
    np.testing.assert_allclose(attached(V, positions), each, atol=1e-6)
    none, frames = np.zeros(0, np.int32), jnp.asarray(V)
    nothing = pin_extension(SCENE.garment, none)
    assert attach(frames, jnp.zeros((2, 0, 3)), pins=none, extension=nothing) is frames
