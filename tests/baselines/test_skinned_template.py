"""The template carried by its seeds, against a rollout's start, through every door of the interface."""

from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax import aot_cache
from garment_jax.baselines import METHODS, Runner, skinned_template
from garment_jax.body.root_frame import from_root, heading, to_root
from garment_jax.body.seeds import make_seeds
from garment_jax.config import CollisionConfig, RolloutConfig
from garment_jax.dataset.motion_input import motion_input
from garment_jax.dataset.start import make_skinned_template
from garment_jax.evaluation.penetration import closed_surface, neighbour_faces, signed_distance
from garment_jax.postprocess import pipeline
from garment_jax.stability.subject import root_frame_collider
from tests.animation.tiny_model import SCENE
from tests.baselines.small import MOTION, SMALL, animated, fitted, looped, shortened, whole, write_data
from tests.reference.scene import make_motion


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_data(tmp_path_factory.mktemp("data"))


@pytest.fixture(scope="module")
def runner(folder: Path) -> Runner:
    return fitted("skinned_template", folder)


def expected() -> np.ndarray:
    seeds = make_seeds(SCENE, SMALL.body.seeds)
    x = motion_input(MOTION, SCENE, seeds, SMALL.body.motion_joints)
    T = SCENE.garment.template - SCENE.body.joints[0]
    return np.asarray(make_skinned_template(T, seeds, SMALL.body.tau)(x.R_seed, x.t_seed))


def test_frames_chunks_and_motions_side_by_side_are_the_skinned_template(runner: Runner) -> None:
    np.testing.assert_allclose(whole(runner), expected(), atol=1e-6)
    np.testing.assert_allclose(looped(runner), expected(), atol=1e-6)
    assert runner.rollout_batch is not None
    both = runner.rollout_batch(SCENE, [shortened(MOTION, 4), MOTION], "two")
    np.testing.assert_allclose(both[1], expected(), atol=1e-6)
    np.testing.assert_allclose(both[0], expected()[:4], atol=1e-6)


def test_the_world_has_the_pins_where_the_body_holds_them(runner: Runner) -> None:
    made = runner.stream(SCENE, MOTION, "x") if runner.stream else None
    assert made is not None
    V, world = animated(runner), from_root(expected().astype(np.float64), made.root, made.yaw)
    assert V.shape == world.shape
    assert SCENE.pins is not None
    off = np.abs(V - world).max(axis=(0, 2))
    assert off[SCENE.pins.vertices].max() < 0.1
    assert runner.parameters == 0


def sunk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the method draw the cloth in around the body's axis, through the body."""
    usual = skinned_template.rollout
    narrow = jnp.asarray([[[0.5, 1.0, 0.5]]])
    monkeypatch.setattr(skinned_template, "rollout", lambda T, W, x: usual(T, W, x) * narrow)


def deepest_mm(V: np.ndarray) -> float:
    collider = SCENE.collider
    assert collider is not None
    assert SCENE.pins is not None
    free = np.setdiff1d(np.arange(V.shape[1]), SCENE.pins.vertices)
    local = to_root(V.astype(np.float64), MOTION.root, heading(MOTION.rotations[:, 0]))[:, free]
    C, neighbours = root_frame_collider(SCENE, MOTION), neighbour_faces(collider.faces)
    surfaces = (closed_surface(c, collider.faces, neighbours) for c in C)
    return -1e3 * min(float(signed_distance(v, s).min()) for v, s in zip(local, surfaces, strict=True))


def test_collisions_are_handled_where_the_row_asks_for_it(folder: Path, runner: Runner, monkeypatch):
    sunk(monkeypatch)
    run = folder / "skinned_template"
    raw, handled = (animated(METHODS["skinned_template"].load(run, c)) for c in (None, CollisionConfig()))
    assert deepest_mm(raw) > 5
    assert deepest_mm(handled) < 0.1


def test_stretch_is_limited_as_for_ours(folder: Path, runner: Runner, monkeypatch):
    seen = []

    def limit(V, tables):
        seen.append(V.shape)
        return V, 0

    monkeypatch.setattr(pipeline, "strain_limited", limit)
    monkeypatch.setattr(aot_cache, "_key", lambda *_: "another")  # a program of its own
    animated(METHODS["skinned_template"].load(folder / "skinned_template"))
    assert seen


def test_a_folder_without_a_fit_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="holds no fitted baseline yet; fit it first"):
        METHODS["skinned_template"].load(tmp_path)


def test_a_fit_goes_into_its_own_folder_alone(folder: Path) -> None:
    fitted("ridge", folder)
    run, fit = folder / "ridge", METHODS["ridge"].fit
    fit(replace(SMALL, rollout=RolloutConfig(chunk=3)), run, folder)  # learns the same
    with pytest.raises(ValueError, match=r"belongs to another run \(baselines = .*use another --run-dir"):
        fit(replace(SMALL, baselines=replace(SMALL.baselines, ridge=1.0)), run, folder)
    fit(replace(SMALL, baselines=replace(SMALL.baselines, bones=9)), run, folder)  # what it does not read
    with pytest.raises(ValueError, match=r"belongs to another run \(method = 'ridge', not 'ridge_static'"):
        METHODS["ridge_static"].fit(SMALL, run, folder)


def test_another_frame_rate_is_refused(runner: Runner) -> None:
    assert runner.stream is not None
    with pytest.raises(ValueError, match="x has 60 fps and the model was trained at 30; resample"):
        runner.stream(SCENE, make_motion(SCENE, 5, fps=60.0), "x")
