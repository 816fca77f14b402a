"""One step of the local dynamics: shapes, invariances, pins, tethers, gradients at rest."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.body.root_frame import yaw_matrix
from garment_jax.dynamics.features import Body, body_features, cloth_features, edges, last_frames
from garment_jax.dynamics.network import (
    DynamicsCarry,
    dynamics_step,
    from_patches,
    held,
    init_dynamics,
    neighbourhoods,
    to_patches,
)
from garment_jax.dynamics.pose import BodyFrame, body_frames, posed
from garment_jax.structs import Motion
from tests.reference.tiny_dynamics import DYNAMICS, frames, hanging, motion, params, tables
from tests.rollout.tiny_model import SCENE


def one(t: int, body: BodyFrame | None = None) -> BodyFrame:
    return BodyFrame(*(jnp.asarray(leaf[t : t + 1]) for leaf in body or frames(12)))


def step(carry: DynamicsCarry, frame: BodyFrame, p: dict | None = None) -> DynamicsCarry:
    return dynamics_step(p or params(), carry, frame, tables=tables(), config=DYNAMICS)


def test_patches_go_there_and_back():
    x = np.arange(2 * 8 * 12 * 3, dtype=np.float32).reshape(2, 8, 12, 3)
    patches = to_patches(jnp.asarray(x), 4)
    np.testing.assert_array_equal(patches[1, 1, 2], x[1, 4:8, 8:12].ravel())
    np.testing.assert_array_equal(from_patches(patches, 4), x)


@pytest.mark.parametrize("wraps", [True, False])
def test_neighbourhoods_against_a_loop(wraps: bool):
    x = np.random.default_rng(0).normal(size=(1, 3, 4, 2)).astype(np.float32)
    got = np.asarray(neighbourhoods(jnp.asarray(x), wraps))
    for r in range(3):
        for c in range(4):
            for k, (i, j) in enumerate((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)):
                column = (c + j) % 4 if wraps else min(max(c + j, 0), 3)
                expected = x[0, min(max(r + i, 0), 2), column]
                np.testing.assert_array_equal(got[0, r, c, 2 * k : 2 * k + 2], expected)


def test_fresh_parameters_leave_nearly_pure_inertia():
    fresh = init_dynamics(jax.random.key(1), tables(), config=DYNAMICS)
    V = hanging().V
    at_rest = one(0)
    moving = DynamicsCarry(V, V - np.float32(0.001))
    free = np.setdiff1d(np.arange(V.shape[1]), tables().pins)
    loose = tables()._replace(tether=np.full(V.shape[1], 9.0, np.float32))
    after = dynamics_step(fresh, moving, at_rest, tables=loose, config=DYNAMICS)
    moved = np.asarray(after.V - V)[0, free]
    np.testing.assert_allclose(moved, 0.001, atol=2e-3)


def test_moving_or_turning_the_whole_motion_changes_nothing():
    own = motion(12)
    Q = yaw_matrix(np.array(np.deg2rad(137.0)))
    other = Motion(
        (Q @ own.rotations.astype(np.float64)).astype(np.float32),
        own.root @ Q.T + [100.0, 0.0, -50.0],
        own.fps,
    )
    placed, bodies = [], (frames(12), body_frames(other, SCENE.body))
    for body in bodies:
        carry = hanging()
        for t in range(12):
            carry = step(carry, one(t, body))
        placed.append(np.asarray(carry.V))
    assert np.abs(placed[0] - hanging().V).max() > 0.005  # it moved at all
    np.testing.assert_allclose(placed[1], placed[0], atol=1e-4)


def test_pins_are_the_bodys_and_no_vertex_leaves_its_tether():
    frame = one(5)
    wild = hanging().V * 40.0
    V = np.asarray(held(jnp.asarray(wild), frame, tables()))
    pins = np.asarray(posed(frame.A, tables().held))
    np.testing.assert_allclose(V[:, tables().pins], pins, atol=1e-6)
    far = np.linalg.norm(V - pins[:, tables().anchor], axis=-1)
    assert (far <= tables().tether * 1.00001).all()
    inside = hanging().V
    np.testing.assert_allclose(held(jnp.asarray(inside), one(0), tables())[:, 40:], inside[:, 40:], atol=0.02)


def test_lanes_side_by_side_are_lanes_alone():
    body = BodyFrame(*(jnp.concatenate([a, b]) for a, b in zip(one(3), one(9), strict=True)))
    V = np.concatenate([hanging().V, 1.01 * hanging().V])
    both = step(DynamicsCarry(V, 0.999 * V), body)
    for k, t in ((0, 3), (1, 9)):
        alone = step(DynamicsCarry(V[k : k + 1], 0.999 * V[k : k + 1]), one(t))
        np.testing.assert_allclose(both.V[k], alone.V[0], atol=2e-6)


def test_the_gradient_at_rest_is_finite():
    def loss(p: dict, V: jax.Array) -> jax.Array:
        carry = step(DynamicsCarry(V, V), one(0), p)
        return jnp.square(step(carry, one(0), p).V).sum()

    gradients = jax.grad(loss, (0, 1))(params(), jnp.asarray(hanging().V))
    assert all(bool(jnp.isfinite(leaf).all()) for leaf in jax.tree.leaves(gradients))


def test_features_of_a_hanging_template_are_those_of_rest():
    x, moved = last_frames(*hanging(), tables())
    identity = np.concatenate([np.eye(3), np.zeros((3, 1))], axis=1).astype(np.float32)
    A = jnp.asarray(np.broadcast_to(identity, (1, len(SCENE.body.joints), 3, 4)))
    f = np.asarray(cloth_features(x, moved, Body(A, A), tables()))
    np.testing.assert_allclose(f[..., :9], 0.0, atol=1e-4)  # off the skinned template, moved, it moved
    np.testing.assert_allclose(np.linalg.norm(f[..., 12:15], axis=-1), 1.0, atol=1e-3)
    np.testing.assert_allclose(f[..., 18:], 0.0, atol=1e-2)  # nothing is stretched


def test_body_features_against_a_loop():
    x, _ = last_frames(*hanging(), tables())
    A, A_before = (jnp.asarray(frames(9).A[k : k + 1]) for k in (8, 7))
    got = np.asarray(body_features(x, Body(A, A_before), tables()))[0]
    points = np.asarray(posed(A, tables().near))[0]
    for r, c in ((0, 0), (2, 5), (3, 7)):
        q = np.asarray(x)[0, 2 * r + 1, 2 * c + 1]
        k = np.linalg.norm(points - q, axis=1).argmin()
        close = np.exp(-np.linalg.norm(points[k] - q) / 0.1)
        np.testing.assert_allclose(got[r, c, 1], close, rtol=1e-3)
        assert np.linalg.norm(got[r, c, 2:5]) == pytest.approx(close, rel=0.1)  # blended


def test_edges_at_a_border_that_is_no_seam_repeat_the_last():
    x = jnp.asarray(np.random.default_rng(1).normal(size=(1, 4, 5, 3)).astype(np.float32))
    du, dv = edges(x, False)
    np.testing.assert_array_equal(du[:, :, -1], du[:, :, -2])
    np.testing.assert_array_equal(dv[:, -1], dv[:, -2])
    np.testing.assert_array_equal(edges(x, True)[0][:, :, -1], x[:, :, 0] - x[:, :, -1])
