"""Virtual bones: known ones recovered, numbers and matrices there and back, and a slow skinning loop."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.baselines.bones import (
    as_numbers,
    bone_transforms,
    bones_of,
    carried,
    rotation_matrices,
    skinned,
    transforms,
    weighted_rest,
)
from garment_jax.baselines.ssdr_linear import reconstruct

RNG = np.random.default_rng(0)
REST = RNG.normal(size=(60, 3)).astype(np.float32)


def known(frames: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two or three of four bones a vertex, and their motions far from the origin."""
    weights = np.zeros((60, 4))
    for i in range(60):
        chosen = RNG.permutation(4)[: 1 + i % 3]
        weights[i, chosen] = RNG.dirichlet(np.ones(len(chosen)))
    R = Rotation.from_rotvec(RNG.normal(size=(frames * 4, 3))).as_matrix().reshape(frames, 4, 3, 3)
    return weights, R, 5 + RNG.normal(size=(frames, 4, 3))


def slow_skinning(weights: np.ndarray, R: np.ndarray, T: np.ndarray) -> np.ndarray:
    out = np.zeros((len(R), len(REST), 3))
    for t in range(len(R)):
        for i, x in enumerate(REST):
            for b in range(weights.shape[1]):
                out[t, i] += weights[i, b] * (R[t, b] @ x + T[t, b])
    return out


def test_carried_is_the_loop() -> None:
    weights, R, T = known(2)
    np.testing.assert_allclose(carried(REST, weights, R, T), slow_skinning(weights, R, T), atol=1e-9)


def test_motions_of_known_bones_reconstruct_their_mesh() -> None:
    weights, R, T = known()
    V = slow_skinning(weights, 0.3 * R[:1] + 0 * R, T)  # no rigid bones do that: an error remains
    assert np.abs(reconstruct(REST, weights, V) - V).max() > 0.05
    near = Rotation.from_rotvec(0.2 * RNG.normal(size=(20, 3))).as_matrix().reshape(5, 4, 3, 3)
    V = slow_skinning(weights, near, T)
    error = np.linalg.norm(reconstruct(REST, weights, V) - V, axis=-1)
    assert np.sqrt(np.square(error).mean()) < 0.15 * V.std(axis=1).mean()
    found, _ = bone_transforms(REST, V, np.eye(4)[weights.argmax(axis=1)])
    assert np.allclose(np.linalg.det(found), 1, atol=1e-6)


def test_one_bone_a_vertex_is_recovered_exactly() -> None:
    _, R, T = known()
    weights = np.eye(4)[np.arange(60) % 4]
    found_R, found_T = bone_transforms(REST, slow_skinning(weights, R, T), weights)
    np.testing.assert_allclose(found_R, R, atol=1e-5)
    np.testing.assert_allclose(found_T, T, atol=1e-5)


def test_six_numbers_a_bone_give_the_mesh_back() -> None:
    weights, R, T = known()
    bones = bones_of(REST, weights.astype(np.float32))
    numbers = as_numbers(R, T, bones.centres)
    y, rest = weighted_rest(REST, bones), (bones.weights @ bones.centres).astype(np.float32)
    V = jax.jit(skinned)(numbers, y, rest)
    np.testing.assert_allclose(V, slow_skinning(weights, R, T), atol=1e-4)
    np.testing.assert_allclose(np.swapaxes(jax.jit(transforms)(numbers)[..., :3, :], -1, -2), R, atol=1e-5)


def test_rotations_and_their_gradient_are_right_at_and_near_zero() -> None:
    for size in (0.0, 1e-6, 1e-4, 1e-2, 1.0, 3.1):
        r = size * np.array([0.6, 0.0, -0.8])
        np.testing.assert_allclose(
            rotation_matrices(jnp.asarray(r)), Rotation.from_rotvec(r).as_matrix(), atol=1e-6
        )
    J = jax.jacobian(lambda r: rotation_matrices(r)[2, 1])(jnp.zeros(3))
    np.testing.assert_allclose(J, [1.0, 0.0, 0.0], atol=1e-6)
