"""`penetration` as a loss: its gradient against finite differences, and along a short clip."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.geometry.closest_point import closest_point_exact, closest_point_from
from garment_jax.geometry.surface_tables import make_surface_tables, point_groups
from garment_jax.postprocess.collision import penetration
from tests.geometry.surfaces import brute_signed, bumpy

VERTICES, FACES = bumpy()
TABLES = make_surface_tables(VERTICES, FACES)
EPS = 4e-3


def loss(V, body):
    """The term of section 3.5 of one frame, metres."""
    return penetration(closest_point_exact(V, body, TABLES), eps=EPS)


@lru_cache
def cloud() -> np.ndarray:
    """Points on both sides, none so near to the margin that a small step takes it across."""
    points = np.random.default_rng(2).uniform(-0.35, 0.35, size=(300, 3))
    return points[np.abs(brute_signed(points, VERTICES, FACES) - EPS) > 1e-4]


@lru_cache
def depths() -> np.ndarray:
    """How much each point of the cloud is nearer than the margin, metres."""
    return np.maximum(EPS - brute_signed(cloud(), VERTICES, FACES), 0)


@lru_cache
def compiled():
    """The value and both gradients, one program for all tests; call it with x64 enabled."""
    return jax.jit(jax.value_and_grad(loss, argnums=(0, 1)))


def test_its_value_is_that_of_slow_signed_distances():
    with jax.enable_x64(True):
        value, _ = compiled()(jnp.asarray(cloud()), jnp.asarray(VERTICES))
    assert depths().sum() > 1
    assert float(value) == pytest.approx(depths().sum(), abs=1e-5)


@pytest.mark.parametrize("of", ["garment", "body"])
def test_its_gradient_is_that_of_finite_differences(of):
    argument, step = ("garment", "body").index(of), 1e-6
    rng = np.random.default_rng(5)
    with jax.enable_x64(True):
        at = [jnp.asarray(cloud()), jnp.asarray(VERTICES)]
        slope = compiled()(*at)[1][argument]
        for _ in range(4):
            along = jnp.asarray(rng.normal(size=at[argument].shape))
            ends = []
            for sign in (1, -1):
                moved = list(at)
                moved[argument] = at[argument] + sign * step * along
                ends.append(float(compiled()(*moved)[0]))
            assert float((slope * along).sum()) == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-4)


def test_points_that_are_outside_by_the_margin_have_no_gradient_and_the_others_have_length_one():
    with jax.enable_x64(True):
        slope = np.asarray(compiled()(jnp.asarray(cloud()), jnp.asarray(VERTICES))[1][0])
    np.testing.assert_allclose(np.linalg.norm(slope, axis=1), depths() > 0, atol=1e-6)


def test_a_clip_carries_its_triangles_and_a_few_steps_push_it_out():
    """The form that `penetration` documents for a training: one frame after the other, no search afresh."""
    groups = point_groups(cloud())
    body = jnp.asarray(VERTICES, jnp.float32)

    def clip_loss(V, body):  # [t, n, 3]
        first = closest_point_exact(V[0], body, TABLES).triangle

        def frame(triangle, v):
            at = closest_point_from(triangle, v, body, TABLES, groups)
            return at.triangle, penetration(at, eps=EPS)

        return jax.lax.scan(frame, first, V)[1].sum()

    V = jnp.asarray(cloud()[None] + np.array([0.0, 0.005, 0.01])[:, None, None], jnp.float32)
    step = jax.jit(jax.value_and_grad(clip_loss))
    alone = sum(np.maximum(EPS - brute_signed(np.asarray(v), VERTICES, FACES), 0).sum() for v in V)
    assert float(step(V, body)[0]) == pytest.approx(alone, rel=1e-4)
    values = []
    for _ in range(8):
        value, slope = step(V, body)
        assert np.isfinite(slope).all()
        values.append(float(value))
        V = V - 0.02 * slope
    assert values[-1] < 0.3 * values[0]
