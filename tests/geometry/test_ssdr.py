"""The decomposition against meshes whose bones are known."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from garment_jax.geometry.ssdr import spread_frames, ssdr


def strip(n=180, bones=3, frames=60, seed=0):
    """A tube of `bones` stretches with soft borders, moved by known transforms; weights, R, T, frames."""
    rng = np.random.default_rng(seed)
    along = np.repeat(np.linspace(0, bones, n // 6), 6)
    angle = np.tile(np.arange(6) * np.pi / 3, n // 6)
    rest = np.stack([0.1 * np.cos(angle), along * 0.3, 0.1 * np.sin(angle)], axis=1)
    centre = np.arange(bones) + 0.5
    weights = np.clip(2.5 - 4 * np.abs(along[:, None] - centre), 0.0, 1.0)
    weights /= weights.sum(axis=1, keepdims=True)
    steps = rng.normal(size=(frames, bones, 3)) * 0.6
    R = Rotation.from_rotvec(steps.reshape(-1, 3)).as_matrix().reshape(frames, bones, 3, 3)
    T = rng.normal(size=(frames, bones, 3)) * 0.1 + rng.normal(size=(frames, 1, 3)) * 3
    return rest, weights, R, T, posed(rest, weights, R, T)


def posed(rest, weights, R, T):
    """Linear blend skinning, one vertex and bone after the other."""
    out = np.zeros((len(R), len(rest), 3))
    for i, p in enumerate(rest):
        for j in range(weights.shape[1]):
            out[:, i] += weights[i, j] * (R[:, j] @ p + T[:, j])
    return out


REST, WEIGHTS, R, T, FRAMES = strip()
FOUND = ssdr(REST, FRAMES.astype(np.float32), bones=3, iterations=40, tolerance=1e-6)


def test_known_weights_and_motions_come_back():
    cost = np.abs(WEIGHTS[:, :, None] - FOUND.weights[:, None]).sum(axis=0)
    order = linear_sum_assignment(cost)[1]
    assert FOUND.rmse < 1e-3
    assert np.abs(FOUND.weights[:, order] - WEIGHTS).max() < 0.02
    assert np.abs(FOUND.rotations[:, order] - R).max() < 0.02
    moved = (FOUND.rotations[:, order] - R) @ REST.mean(axis=0) + FOUND.translations[:, order] - T
    assert np.abs(moved).max() < 0.01


def test_the_error_is_that_of_the_skinned_vertices_and_never_rises():
    noisy = FRAMES + np.random.default_rng(1).normal(size=FRAMES.shape) * 0.01
    found = ssdr(REST, noisy, bones=5, iterations=10, tolerance=0.0)
    again = posed(REST, found.weights, found.rotations, found.translations)
    error = np.sqrt(np.square(again - noisy).sum(axis=2).mean())
    history = found.history
    assert found.rmse == pytest.approx(error, rel=1e-3)
    assert history[-1] == pytest.approx(error, rel=2e-2)  # before the last pass over all frames
    assert len(history) == 21
    assert (np.diff(history) <= 1e-9).all()
    assert history[-1] < 0.8 * history[0]


def test_weights_are_few_and_sum_to_one_and_rotations_are_rotations():
    found = ssdr(REST, FRAMES, bones=6, influences=2, iterations=5)
    assert (found.weights >= 0).all()
    assert (np.count_nonzero(found.weights, axis=1) <= 2).all()
    np.testing.assert_allclose(found.weights.sum(axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(found.rotations), 1, atol=1e-5)


def test_a_mirrored_sequence_gives_no_reflection():
    found = ssdr(REST, FRAMES * [-1.0, 1.0, 1.0], bones=3, iterations=3)
    np.testing.assert_allclose(np.linalg.det(found.rotations), 1, atol=1e-5)


def test_the_same_seed_gives_the_same_result_and_memory_maps_are_welcome(tmp_path):
    np.save(tmp_path / "frames.npy", FRAMES.astype(np.float32))
    mapped = np.load(tmp_path / "frames.npy", mmap_mode="r")
    one, two = (ssdr(REST, mapped, bones=3, seed=3, most_frames=20, iterations=5) for _ in range(2))
    np.testing.assert_array_equal(one.weights, two.weights)
    np.testing.assert_array_equal(one.rotations, two.rotations)


def test_frames_left_out_of_the_fit_are_carried_too():
    found = ssdr(REST, FRAMES, bones=3, most_frames=25, iterations=30)
    again = posed(REST, found.weights, found.rotations, found.translations)
    assert np.sqrt(np.square(again - FRAMES).sum(axis=2).mean()) < 2e-3
    chosen = spread_frames(60, 25, 0)
    assert len(chosen) == 25
    assert (np.diff(chosen) > 0).all()


@pytest.mark.parametrize("shape", ["plane", "line", "points", "still"])
def test_degenerate_shapes_are_safe(shape):
    rest = np.random.default_rng(2).random((12, 3))
    rest[:, {"plane": [1], "line": [0, 1]}.get(shape, [])] = 0
    angle = np.linspace(0, 0 if shape == "still" else 1, 7)
    turn = Rotation.from_rotvec(angle[:, None] * [0.0, 1.0, 0.0]).as_matrix()
    frames = np.einsum("tab,nb->tna", turn, rest)
    found = ssdr(rest, frames, bones=12 if shape == "points" else 4, iterations=4)
    assert np.isfinite(found.rotations).all()
    assert found.rmse < 1e-6
    np.testing.assert_allclose(np.linalg.det(found.rotations), 1, atol=1e-5)


def test_refusals():
    with pytest.raises(ValueError, match="200 bones do not fit 180 vertices; choose 1 to 180"):
        ssdr(REST, FRAMES, bones=200)
    with pytest.raises(ValueError, match=r"shape \(60, 179, 3\) do not fit \(180, 3\) rest"):
        ssdr(REST, FRAMES[:, 1:], bones=2)
    with pytest.raises(ValueError, match="influences=0 leaves a vertex without a bone"):
        ssdr(REST, FRAMES, bones=2, influences=0)
    broken = FRAMES.copy()
    broken[4, 2, 1] = np.nan
    with pytest.raises(ValueError, match="frame 4 holds values that are not finite"):
        ssdr(REST, broken, bones=2)
