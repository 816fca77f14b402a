"""Seconds of a step out of a log, and the configuration that such a log is of."""

import pytest

from garment_jax.learning.calibration import STEPS, step_seconds, with_steps
from garment_jax.learning.networks import config_for
from tests.reference.scene import make_scene


def test_compiling_and_the_first_steps_do_not_count() -> None:
    log = [{"stage": "motion", "seconds": s} for s in (30.0, 30.1, 31.0, 33.0, 35.0)]
    log += [{"stage": "detail", "seconds": s} for s in (5.0, 5.1, 5.3, 5.4, 9.0)]
    assert step_seconds(log) == {"motion": pytest.approx(2.0), "detail": pytest.approx(1.85)}


def test_only_stages_that_are_trained_are_measured() -> None:
    config = config_for(make_scene(), {"generative": 1, "column_rnn": 0}, seconds=10.0, seed=0)
    few = with_steps(config, STEPS)
    assert (few.generative.steps, few.motion.warm_up_steps) == (STEPS["generative"], STEPS["warm_up"])
    assert few.column_rnn.steps == 0
    assert few.training.log_every == 1
