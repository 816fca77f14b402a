import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.geometry.closest_point import closest_point_exact
from garment_jax.postprocess.collision.projection import initial_state, penetration
from tests.postprocess.collision.cloth import PINS, resolve, sheet, tables

exact = jax.jit(closest_point_exact)


def _points(seed: int = 0) -> jax.Array:
    return jnp.asarray(np.random.default_rng(seed).uniform(-0.3, 0.3, (576, 3)), jnp.float32)


def test_penetration_by_hand_and_its_gradient():
    made, body, _ = tables()
    V = _points()

    def loss(V):
        return penetration(closest_point_exact(V, jnp.asarray(body), made.surface))

    value, gradient = jax.jit(jax.value_and_grad(loss))(V)
    at = exact(V, jnp.asarray(body), made.surface)
    inside = np.asarray(at.ds) < 1e-3
    np.testing.assert_allclose(value, (1e-3 - np.asarray(at.ds)[inside]).sum(), rtol=1e-5)
    np.testing.assert_allclose(gradient[~inside], 0.0)
    np.testing.assert_allclose(gradient[inside], -at.direction[inside], atol=2e-3)


def test_the_first_state_claims_nothing_and_its_frame_finds_everything():
    made, body, _ = tables()
    V = jnp.asarray(sheet(0.16)[0])
    state = initial_state(V, jnp.asarray(body), made.surface)
    assert not state.outside.any()
    at = exact(V, jnp.asarray(body), made.surface)
    assert ((state.triangle >= 0) & (state.triangle < len(made.surface.faces))).all()
    result, _ = resolve(V, body, state)
    free = np.delete(np.asarray(at.ds), PINS)
    assert result.penetrating_before == (free < 0).sum() > 0
    np.testing.assert_allclose(result.deepest_before, -free.min(), atol=1e-6)
