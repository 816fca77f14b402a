import numpy as np
import pytest

from garment_jax.evaluation.sted import FLOOR, spatial_part, sted, temporal_part
from garment_jax.geometry.topology import unique_edges
from tests.reference.scene import make_motion, make_scene, make_vertices


def _clip(seed, frames=12):
    scene = make_scene(rings=4, columns=8)
    motion = make_motion(scene, frames, 0)
    return make_vertices(scene, motion, seed).astype(np.float64), scene.garment.faces


def test_spatial_part_equals_a_naive_loop():
    (V, faces), (V_star, _) = _clip(1, 3), _clip(2, 3)
    edges = unique_edges(faces)
    expected = np.zeros(V.shape[:2])
    for t in range(len(V)):
        for i in range(V.shape[1]):
            ring = [e for e in edges if i in e]
            true = np.array([np.linalg.norm(V_star[t, a] - V_star[t, b]) for a, b in ring])
            ours = np.array([np.linalg.norm(V[t, a] - V[t, b]) for a, b in ring])
            relative = (ours - true) / true
            mean = np.average(relative, weights=true)
            expected[t, i] = np.sqrt(np.average((relative - mean) ** 2, weights=true))
    np.testing.assert_allclose(spatial_part(V, V_star, edges), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("window", [1, 5, 99])
def test_temporal_part_equals_a_naive_loop(window):
    (V, _), (V_star, _) = _clip(1), _clip(2)
    for t in range(len(V) - 1):
        near = range(max(0, t - window // 2), min(len(V) - 1, t + window // 2 + 1))
        for i in range(0, V.shape[1], 7):
            mean = np.mean([np.linalg.norm(V_star[s + 1, i] - V_star[s, i]) for s in near])
            true = np.linalg.norm(V_star[t + 1, i] - V_star[t, i])
            ours = np.linalg.norm(V[t + 1, i] - V[t, i])
            got = temporal_part(V, V_star, window_frames=window)[t, i]
            assert got == pytest.approx(abs(ours - true) / max(mean, FLOOR))


def test_uniform_scaling_and_equality_cost_nothing_in_space():
    V_star, faces = _clip(3)
    assert sted(V_star, V_star, faces).combined == 0.0
    assert sted(1.2 * V_star, V_star, faces).spatial == pytest.approx(0.0, abs=1e-9)


def test_parts_combine_and_settings_are_stated():
    (V, faces), (V_star, _) = _clip(1), _clip(2)
    result = sted(V, V_star, faces, c=0.5, window_frames=5)
    assert result.combined == pytest.approx(np.hypot(result.spatial, 0.5 * result.temporal))
    assert (result.c, result.window_frames, result.neighbourhood) == (0.5, 5, "one-ring")


def test_a_still_truth_gives_a_finite_number():
    V_star, faces = _clip(3)
    still = np.repeat(V_star[:1], 5, axis=0)
    assert np.isfinite(sted(V_star[:5], still, faces).temporal)
    assert sted(still, still, faces).combined == 0.0


def test_refusals():
    V, faces = _clip(1, 2)
    with pytest.raises(ValueError, match="not 1"):
        sted(V[:1], V[:1], faces)
    with pytest.raises(ValueError, match="window_frames=4"):
        sted(V, V, faces, window_frames=4)
