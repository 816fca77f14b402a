"""What the stages hand to each other: codes, cached once, and the choice of what detail learns from."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.config import DataConfig
from garment_jax.data.prepared import frames_of
from garment_jax.generative.network import encode
from garment_jax.rollout.scan import latent_rollout
from garment_jax.structs import TrainState
from garment_jax.training import detail_stage, generative_stage, motion_stage
from garment_jax.training.codes import true_codes
from garment_jax.training.run import Run, open_run
from tests.reference.scene import make_motion, write_clip
from tests.rollout.tiny_model import CONFIG, SCENE, alone, first_state, tiny_model


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory):
    """An open run on one clip, its mirror image, and one kept back; nothing is trained."""
    folder = tmp_path_factory.mktemp("stages")
    for name, frames in (("waltz", 9), ("short", 6)):
        write_clip(
            folder / "train" / f"{name}.h5", scene=SCENE, motion=make_motion(SCENE, frames, seed=frames)
        )
    config = replace(
        CONFIG, data=DataConfig(validation=("short",)), detail=replace(CONFIG.detail, source="rollout")
    )
    opened = open_run(config, folder / "run", data_dir=folder)
    yield opened
    opened.log.close()


def test_true_codes_are_the_encoders_means_of_every_clip_and_cached(run: Run, capsys):
    params = tiny_model().params["generative"]
    Z = true_codes(run, params)
    assert [z.shape for z in Z] == [(9, 8), (9, 8)]
    V = frames_of(run.data.train[1], np.arange(9), run.data)[0]
    mean = jax.jit(lambda V: encode(params, V, template=run.template, config=CONFIG.generative).mean)
    np.testing.assert_allclose(Z[1], mean(jnp.asarray(V)), atol=1e-4)
    assert "encoding the training clips" in capsys.readouterr().err
    for again, code in zip(true_codes(run, {}), Z, strict=True):
        np.testing.assert_array_equal(again, code)
    assert not capsys.readouterr().err


def test_detail_can_learn_from_free_rollouts(run: Run):
    params = tiny_model().params
    codes = detail_stage._codes(run, params["generative"], params["motion"])
    assert [z.shape for z in codes] == [(9, 8), (9, 8)]
    x = run.data.train[0].input
    state = alone(first_state(x))
    rolled = jax.jit(lambda p, s, x: latent_rollout(p, s, x, template=run.template, config=CONFIG))
    np.testing.assert_allclose(codes[0], rolled(params, state, x.x)[1], atol=1e-4)
    again = detail_stage._codes(run, {}, {})
    np.testing.assert_array_equal(again[1], codes[1])


def test_validation_is_a_reconstruction_then_a_rollout_of_the_clip_kept_back(run: Run):
    params, none = tiny_model().params, jnp.zeros(())
    rebuild = generative_stage._validation(run)
    roll = motion_stage._validation(run, params["generative"])
    assert rebuild is not None
    assert roll is not None
    for validate, part in ((rebuild, "generative"), (roll, "motion")):
        errors = validate(TrainState(params[part], (), none, none))
        assert set(errors) == {"rmse_cm", "short_rmse_cm"}
        assert 0 < errors["rmse_cm"] < 1000


def test_without_clips_kept_back_there_is_no_validation(run: Run):
    bare = run._replace(data=run.data._replace(validation=[]))
    assert generative_stage._validation(bare) is None
    assert motion_stage._validation(bare, {}) is None


def test_the_linear_garment_is_that_of_the_codes(run: Run):
    Z = [np.random.default_rng(k).normal(size=(9, 8)).astype(np.float32) for k in range(2)]
    linear = motion_stage.linear_garment(run, Z)
    assert linear.pooled_modes.shape == (8, 256, 3)
    assert linear.metric.shape == (8, 8)
