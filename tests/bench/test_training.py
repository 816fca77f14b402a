"""What a benchmark's record keeps of a run's log."""

from pathlib import Path

import pytest

from garment_jax.bench.training import log_figures
from garment_jax.training.log import RunLog


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A log of three stages: two checks of the latents, and the column RNN's, whose errors are of cells."""
    log = RunLog(tmp_path)
    log.write("generative", 5, {"loss": 2.0}, seconds=4.0)
    log.write("generative", 8, {"rmse_cm": 1.5}, seconds=7.0, kind="validation")
    log.write("motion", 5, {"rmse_cm": 4.5}, seconds=3.0, kind="validation")
    log.write("motion", 9, {"loss": 1.0}, seconds=6.0)
    log.write("column_rnn", 3, {"rmse_cm": 2.5}, seconds=9.0, kind="validation")
    log.close()
    return tmp_path


def test_seconds_are_by_stage_and_the_curve_is_the_codes(run: Path) -> None:
    found = log_figures(run)
    assert found["stage_seconds"] == {"generative": 7.0, "motion": 6.0, "column_rnn": 9.0}
    assert [(e["stage"], e["seconds"], e["rmse_cm"]) for e in found["curve"]] == [
        ("generative", 7.0, 1.5),
        ("motion", 10.0, 4.5),
    ]
    assert found["validation_cm"] == 4.5


def test_a_run_that_never_checked_has_no_curve(tmp_path: Path) -> None:
    log = RunLog(tmp_path)
    log.write("column_rnn", 3, {"rmse_cm": 2.5}, seconds=9.0, kind="validation")
    log.close()
    assert log_figures(tmp_path) == {"stage_seconds": {"column_rnn": 9.0}, "curve": [], "validation_cm": None}
