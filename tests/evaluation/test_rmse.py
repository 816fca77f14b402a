import numpy as np
import pytest

from garment_jax.evaluation.rmse import rmse, rmse_per_frame, vertex_distance


def test_rmse_worked_by_hand():
    V_star = np.zeros((2, 2, 3), np.float32)
    V = V_star.copy()
    V[0, 0] = [0.03, 0.04, 0.0]  # 5 cm
    V[1, 1] = [0.0, 0.0, 0.01]  # 1 cm
    assert rmse(V, V_star) == pytest.approx(np.sqrt((25 + 1) / 4))
    assert vertex_distance(V, V_star).mean() == pytest.approx(1.5)
    np.testing.assert_allclose(rmse_per_frame(V, V_star), [np.sqrt(25 / 2), np.sqrt(1 / 2)], rtol=1e-6)


def test_clip_rmse_is_the_root_of_the_mean_of_squares_of_frames():
    rng = np.random.default_rng(0)
    V, V_star = rng.normal(size=(2, 5, 7, 3))
    frames = rmse_per_frame(V, V_star)
    assert rmse(V, V_star) == pytest.approx(np.sqrt((frames**2).mean()))
    assert rmse(V[0], V_star[0]) == pytest.approx(frames[0])


def test_different_shapes_are_refused_not_broadcast():
    with pytest.raises(ValueError, match=r"\(1, 4, 3\).*\(5, 4, 3\)"):
        vertex_distance(np.zeros((1, 4, 3)), np.zeros((5, 4, 3)))
