"""What the stages hand to each other: latents, cached once, and the choice of what detail learns from."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax import progress
from garment_jax.config import DataConfig
from garment_jax.dataset.prepared import frames_of
from garment_jax.model.compose import init_state
from garment_jax.model.generative.canonical import posed
from garment_jax.model.generative.network import decode, encode
from garment_jax.model.scan import latent_rollout, make_rollout
from garment_jax.structs import FrameInput
from garment_jax.training import detail_stage, generative_stage, motion_stage
from garment_jax.training.latents import true_latents
from garment_jax.training.run import Run, open_run
from tests.animation.tiny_model import CONFIG, SCENE, alone, canonical_model, first_state, tiny_model
from tests.reference.scene import make_motion, write_clip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two clips."""
    folder = tmp_path_factory.mktemp("stages")
    for name, frames in (("waltz", 9), ("short", 6)):
        write_clip(
            folder / "train" / f"{name}.h5", scene=SCENE, motion=make_motion(SCENE, frames, seed=frames)
        )
    return folder


def opened(folder: Path, reach: float) -> Iterator[Run]:
    config = replace(
        CONFIG,
        data=DataConfig(validation=("short",)),
        generative=replace(CONFIG.generative, skin_reach=reach),
        detail=replace(CONFIG.detail, source="rollout"),
    )
    run = open_run(config, folder / f"run_{reach:g}", data_dir=folder)
    yield run
    run.log.close()


@pytest.fixture(scope="module")
def run(folder: Path):
    """An open run on one clip, its mirror image, and one kept back; nothing is trained."""
    yield from opened(folder, 0.0)


@pytest.fixture(scope="module")
def canonical(folder: Path):
    """The same with its networks in canonical pose."""
    yield from opened(folder, 0.1)


def test_true_codes_are_the_encoders_means_of_every_clip_and_cached(run: Run, capsys, monkeypatch):
    monkeypatch.setattr(progress, "_LINE_SECONDS", 0.0)
    monkeypatch.setattr(progress, "_FIRST_SECONDS", 0.0)
    params = tiny_model().params["generative"]
    Z = true_latents(run, params)
    assert [z.shape for z in Z] == [(9, 8), (9, 8)]
    V = frames_of(run.data.train[1], np.arange(9), run.data)
    mean = jax.jit(lambda V: encode(params, V, template=run.template, config=CONFIG.generative).mean)
    np.testing.assert_allclose(Z[1], mean(jnp.asarray(V)), atol=1e-4)
    assert "motion: 18/18 frames" in capsys.readouterr().err
    for again, code in zip(true_latents(run, {}), Z, strict=True):
        np.testing.assert_array_equal(again, code)
    assert not capsys.readouterr().err
    cache = run.folder / "cache" / "true_latents.npz"
    cache.write_bytes(cache.read_bytes()[:-99])  # damaged, it is made anew
    for again, code in zip(true_latents(run, params), Z, strict=True):
        np.testing.assert_array_equal(again, code)


def test_detail_can_learn_from_free_rollouts(run: Run):
    params = tiny_model().params
    latents = detail_stage._latents(run, params["generative"], params["motion"])
    assert [z.shape for z in latents] == [(9, 8), (9, 8)]
    x = run.data.train[0].input
    state = alone(first_state(x)).motion
    rolled = jax.jit(lambda p, s, x: latent_rollout(p, s, x, template=run.template, config=CONFIG))
    np.testing.assert_allclose(latents[0], rolled(params, state, x.x)[1], atol=1e-4)
    again = detail_stage._latents(run, {}, {})
    np.testing.assert_array_equal(again[1], latents[1])


def test_validation_is_a_reconstruction_then_a_rollout_of_the_clip_kept_back(run: Run):
    params = tiny_model().params
    rebuild = generative_stage._validation(run)
    roll = motion_stage._validation(run, params["generative"])
    assert rebuild is not None
    assert roll is not None
    for validate, part in ((rebuild, "generative"), (roll, "motion")):
        errors = validate(params[part])
        assert set(errors) == {"rmse_cm", "short_rmse_cm"}
        assert 0 < errors["rmse_cm"] < 1000


def test_in_canonical_pose_validation_is_in_the_root_frame(canonical: Run):
    model = canonical_model()
    params = {k: model.params[k] for k in ("generative", "motion")}
    clip, tables = canonical.data.validation[0], canonical.template
    roll = motion_stage._validation(canonical, params["generative"])
    rebuild = generative_stage._validation(canonical)
    assert roll is not None
    assert rebuild is not None
    found = roll(params["motion"])["short_rmse_cm"]
    start = init_state(params, jnp.asarray(tables.T), template=tables, config=model.config)
    V = make_rollout(tables, canonical.config)(params, start, clip.input.x)[1]
    assert found == pytest.approx(100 * np.sqrt(np.square(V - clip.V).sum(axis=-1).mean()), rel=1e-4)

    @jax.jit
    def rebuilt(params: dict, U: jax.Array, x: FrameInput):
        options = {"template": tables, "config": canonical.config.generative}
        return posed(decode(params, encode(params, U, **options).mean, **options).V, x, template=tables)

    found = rebuild(params["generative"])["short_rmse_cm"]
    V = rebuilt(params["generative"], clip.U[::4], jax.tree.map(lambda leaf: leaf[::4], clip.input.x))
    error = 100 * np.sqrt(np.square(V - clip.V[::4]).sum(axis=-1).mean())
    assert found == pytest.approx(error, rel=1e-3)


def test_in_canonical_pose_lanes_begin_from_the_template_itself(canonical: Run):
    R, t = canonical.data.train[0].input.R_seed[:2], canonical.data.train[0].input.t_seed[:2]
    np.testing.assert_array_equal(canonical.skinned(R, t), np.stack([canonical.template.T] * 2))


def test_without_clips_kept_back_there_is_no_validation(run: Run):
    bare = run._replace(data=run.data._replace(validation=[]))
    assert generative_stage._validation(bare) is None
    assert motion_stage._validation(bare, {}) is None


def test_the_linear_garment_is_that_of_the_codes(run: Run):
    Z = [np.random.default_rng(k).normal(size=(9, 8)).astype(np.float32) for k in range(2)]
    linear = motion_stage.linear_garment(run, Z)
    assert linear.pooled_modes.shape == (8, 256, 3)
    assert linear.metric.shape == (8, 8)
