import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garment_jax.geometry import skinning
from tests.reference import skinning as slow

TAU = 0.03
# compiled whole: operation by operation takes longer to compile than to test
softmax_weights = jax.jit(skinning.softmax_weights, static_argnames="tau")
skin, unskin, unskin_sequence = (
    jax.jit(f) for f in (skinning.skin, skinning.unskin, skinning.unskin_sequence)
)
unskin_fixed_point = jax.jit(skinning.unskin_fixed_point, static_argnames=("tau", "iterations"))


def problem(n: int = 20, m: int = 6, seed: int = 0, angle: float = 0.5):
    """Points and seeds within half a metre, seed transforms that turn by about `angle` radians."""
    rng = np.random.default_rng(seed)
    points, seeds = rng.uniform(-0.3, 0.3, (n, 3)), rng.uniform(-0.3, 0.3, (m, 3))
    R = Rotation.from_rotvec(angle * rng.uniform(-1, 1, (m, 3))).as_matrix()
    t = rng.uniform(-0.2, 0.2, (m, 3))
    return points, seeds, R, t


def single(*arrays: np.ndarray) -> list[jax.Array]:
    return [jnp.asarray(a, jnp.float32) for a in arrays]


def test_weights_are_the_slow_ones_and_rows_sum_to_1():
    points, seeds, _, _ = problem()
    W = softmax_weights(*single(points, seeds), tau=TAU)
    np.testing.assert_allclose(W, slow.softmax_weights(points, seeds, TAU), atol=2e-5)
    np.testing.assert_allclose(W.sum(axis=1), 1, rtol=1e-5)


def test_a_garment_10_metres_away_still_has_rows_that_sum_to_1():
    points, seeds, _, _ = problem()
    far = points + [10.0, 0, 0]
    W = softmax_weights(*single(far, seeds), tau=1e-3)
    np.testing.assert_allclose(W.sum(axis=1), 1, rtol=1e-5)
    np.testing.assert_array_equal(W.argmax(axis=1), slow.softmax_weights(far, seeds, 1e-3).argmax(axis=1))


def test_coincident_seeds_share_alike_and_a_point_on_a_seed_has_a_finite_gradient():
    points, seeds, _, _ = problem()
    seeds[1] = seeds[0]
    points[0] = seeds[0]
    x, s = single(points, seeds)
    W = softmax_weights(x, s, tau=TAU)
    np.testing.assert_allclose(W[:, 0], W[:, 1], rtol=1e-6)
    gradient = jax.jit(jax.grad(lambda x: (softmax_weights(x, s, tau=TAU) ** 2).sum()))(x)
    assert np.isfinite(gradient).all()
    assert np.abs(gradient).max() > 0
    alone = jax.jit(jax.grad(lambda x: (softmax_weights(x, s[:1], tau=TAU)).sum()))(x[:1])
    np.testing.assert_array_equal(alone, 0)


def test_skin_and_unskin_are_the_slow_ones():
    points, seeds, R, t = problem()
    W = slow.softmax_weights(points, seeds, TAU)
    posed = slow.skin(points, W, R, t)
    np.testing.assert_allclose(skin(*single(points, W, R, t)), posed, atol=1e-6)
    unposed, condition = unskin(*single(posed, W, R, t))
    np.testing.assert_allclose(unposed, slow.unskin(posed, W, R, t), atol=1e-5)
    assert (condition >= 1 - 1e-3).all()
    assert (condition < 3).all()


def test_unskin_undoes_skin_and_a_rotation_has_condition_1():
    points, seeds, R, t = single(*problem())
    R, t = jnp.broadcast_to(R[:1], R.shape), jnp.broadcast_to(t[:1], t.shape)
    W = softmax_weights(points, seeds, tau=TAU)
    back, condition = unskin(skin(points, W, R, t), W, R, t)
    np.testing.assert_allclose(back, points, atol=3e-6)
    np.testing.assert_allclose(condition, 1, atol=1e-5)


def test_opposite_rotations_stay_finite_and_the_condition_says_so():
    R = jnp.asarray(Rotation.from_rotvec([[0, 0, 0], [np.pi, 0, 0]]).as_matrix(), jnp.float32)
    t, W = jnp.zeros((2, 3)), jnp.array([[0.5, 0.5], [1.0, 0.0]])
    V = jnp.array([[0.2, 0.3, -0.1], [0.2, 0.3, -0.1]])
    unposed, condition = unskin(V, W, R, t)
    assert np.isfinite(unposed).all()
    assert condition[0] > 100
    assert condition[1] == pytest.approx(1, abs=1e-4)
    np.testing.assert_allclose(unposed[0, 0], 0.2, rtol=1e-4)  # the axis that both leave alone
    gradient = jax.jit(jax.grad(lambda V: unskin(V, W, R, t)[0].sum()))(V)
    assert np.isfinite(gradient).all()


@pytest.mark.parametrize("short", [0.0, 1e-3, 1e-2, 0.1, 1.0])
def test_nearly_opposite_rotations_give_the_damped_inverse_of_float64(short):
    rng = np.random.default_rng(3)
    axes = rng.normal(size=(50, 3))
    turned = Rotation.from_rotvec((np.pi - short) * axes / np.linalg.norm(axes, axis=1)[:, None]).as_matrix()
    R = np.concatenate([np.eye(3)[None], turned])
    W = np.concatenate([np.full((50, 1), 0.5), np.eye(50) / 2], axis=1)
    V = rng.uniform(-0.5, 0.5, (50, 3))
    d = skinning.DAMPING
    expected = np.zeros((50, 3))
    for i in range(50):
        A = (np.eye(3) + turned[i]) / 2
        expected[i] = np.linalg.solve(A.T @ A + d**2 * np.eye(3), A.T @ V[i])
    unposed, condition = unskin(*single(V, W, R, np.zeros((51, 3))))
    assert np.abs(unposed).max() < 0.9 / (2 * d)
    # at the exact half turn the float32 matrices themselves leave a little of the lost directions
    np.testing.assert_allclose(unposed, expected, atol=0.1 if short < 1e-2 else 2e-3, rtol=2e-3)
    assert (condition > 1.02).all() if short else (condition > 100).all()


def test_even_a_matrix_of_zeros_is_inverted_to_something_finite():
    R = jnp.asarray(
        [np.diag([1.0, 1, 1]), np.diag([-1.0, -1, -1])], jnp.float32
    )  # no rotation: the worst case
    unposed, _ = unskin(jnp.ones((1, 3)), jnp.array([[0.5, 0.5]]), R, jnp.zeros((2, 3)))
    assert np.isfinite(unposed).all()


def test_the_fixed_point_is_the_slow_iteration_and_agrees_with_itself():
    points, seeds, R, t = problem(angle=0.15)
    t *= 0.1
    T, tau = points, 0.2
    truth = points + np.random.default_rng(1).normal(scale=0.01, size=points.shape)
    V = slow.skin(truth, slow.softmax_weights(truth, seeds, tau), R, t)
    errors = []
    for iterations in (1, 4):
        x = T
        for _ in range(iterations):
            x = slow.unskin(V, slow.softmax_weights(x, seeds, tau), R, t)
        found = unskin_fixed_point(*single(V, T, seeds, R, t), tau=tau, iterations=iterations)
        np.testing.assert_allclose(found.T_tilde, x, atol=2e-5)
        np.testing.assert_allclose(found.W.sum(axis=1), 1, rtol=1e-5)
        errors.append(np.abs(found.T_tilde - truth).max())
    assert errors[1] < 0.05 * errors[0]
    posed = skin(*single(x, slow.softmax_weights(x, seeds, tau), R, t))
    np.testing.assert_allclose(posed, V, atol=1e-3)


def test_a_sequence_is_one_frame_after_the_other():
    points, seeds, R, t = problem()
    W = softmax_weights(*single(points, seeds), tau=TAU)
    V, Rs, ts = single(np.stack([points, 2 * points]), np.stack([R, R[::-1]]), np.stack([t, t[::-1]]))
    together, condition = unskin_sequence(V, W, Rs, ts)
    for k in range(2):
        alone = unskin(V[k], W, Rs[k], ts[k])
        np.testing.assert_allclose(together[k], alone[0], atol=1e-6)
        np.testing.assert_allclose(condition[k], alone[1], rtol=1e-5)
