"""Ridge regression: against NumPy's least squares on an augmented system, and rolled out by a slow loop."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.baselines import Runner
from garment_jax.baselines.features import columns
from garment_jax.baselines.ridge import fit_ridge, rollout, with_past
from garment_jax.body.motion_features import feature_names
from tests.animation.tiny_model import SCENE
from tests.baselines.small import MOTION, SMALL, animated, fitted, looped, shortened, whole, write_data


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_data(tmp_path_factory.mktemp("data"))


@pytest.fixture(scope="module", params=["ridge_static", "ridge"])
def runner(request: pytest.FixtureRequest, folder: Path) -> Runner:
    return fitted(request.param, folder)


def test_the_fit_is_least_squares_of_the_augmented_system_whatever_the_pieces() -> None:
    rng = np.random.default_rng(3)
    x, y = rng.normal(size=(40, 6)), rng.normal(size=(40, 4))
    W = fit_ridge(((x[i : i + 7], y[i : i + 7]) for i in range(0, 40, 7)), 2.5)
    rows = np.concatenate([np.concatenate([x, np.ones((40, 1))], 1), np.sqrt(2.5) * np.eye(6, 7)])
    expected = np.linalg.lstsq(rows, np.concatenate([y, np.zeros((6, 4))]), rcond=None)[0]
    np.testing.assert_allclose(W, expected, atol=1e-8)
    with pytest.raises(ValueError, match="no frames to fit"):
        fit_ridge([], 1.0)


def test_the_past_is_the_last_frame_then_the_one_before() -> None:
    x, c = np.arange(4.0)[:, None], 10 + np.arange(4.0)[:, None]
    rows, targets = with_past(x, c)
    np.testing.assert_array_equal(rows, [[2, 11, 10], [3, 12, 11]])
    np.testing.assert_array_equal(targets, c[2:])


@pytest.mark.parametrize("past", [True, False])
def test_a_rollout_is_the_loop_that_one_would_write(past: bool) -> None:
    rng = np.random.default_rng(1)
    params = {
        "motion": rng.normal(size=(3, 2)),
        "constant": rng.normal(size=2),
        "deviation": np.array([2.0, 0.5]),
        "basis": rng.normal(size=(2, 6)),
        "mean": rng.normal(size=6),
    } | ({"past": 0.3 * rng.normal(size=(4, 2))} if past else {})
    x, state = rng.normal(size=(5, 3)), rng.normal(size=(2, 2))
    c, expected = [state[1], state[0]], []
    for row in x:
        new = row @ params["motion"] + params["constant"]
        if past:
            new = new + c[-1] @ params["past"][:2] + c[-2] @ params["past"][2:]
        c.append(new)
        expected.append((new * params["deviation"]) @ params["basis"] + params["mean"])
    single = jax.tree.map(np.float32, params)
    begin, rows = jnp.asarray(state, jnp.float32), jnp.asarray(x, jnp.float32)
    last, V = jax.jit(rollout)(single, begin, rows)
    np.testing.assert_allclose(V, expected, atol=1e-4)
    np.testing.assert_allclose(last, [c[-1], c[-2]] if past else state, atol=1e-5)
    both = jax.jit(rollout)(single, begin[:, None].repeat(3, 1), rows[:, None].repeat(3, 1))
    np.testing.assert_allclose(both[1][:, 2], expected, atol=1e-4)


def test_frames_chunks_and_motions_side_by_side_agree_and_do_not_see_the_future(runner: Runner) -> None:
    V = whole(runner)
    np.testing.assert_allclose(looped(runner), V, atol=1e-5)
    assert runner.rollout_batch is not None
    both = runner.rollout_batch(SCENE, [shortened(MOTION, 6), MOTION], "two")
    np.testing.assert_allclose(both[1], V, atol=1e-5)
    np.testing.assert_allclose(both[0], V[:6], atol=1e-5)
    assert np.isfinite(animated(runner)).all()
    assert runner.parameters > 0


def test_columns_are_the_features_that_a_method_may_read() -> None:
    names = feature_names(SMALL.body.motion_joints)
    pose = [names[i] for i in columns(SCENE.body, SMALL, "pose")]
    assert pose == [name for name in names if "rotation" in name]
    root = {names[i] for i in columns(SCENE.body, SMALL, "pose and root")}
    assert root == {name for name in names if "root" in name or "rotation" in name}
    moving = {names[i] for i in columns(SCENE.body, SMALL, "pose and velocities")}
    assert moving == {name for name in names if "position" not in name}
