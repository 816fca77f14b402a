import numpy as np
import pytest

from garment_jax.evaluation.determined import PARTED_CM, against_again, determined_frames


def test_determined_is_what_comes_before_the_first_parting_and_nothing_after_it():
    away = np.array([0.1, PARTED_CM, 0.6, 0.1, 2.0])
    assert determined_frames(away) == 2  # exactly half a centimetre has not passed it
    assert determined_frames(away[:2]) == 2
    assert determined_frames(away[2:]) == 0


def test_error_before_is_an_error_and_after_a_multiple_of_the_second_runs():
    error, away = np.array([3.0, 4.0, 6.0, 8.0]), np.array([0.0, 0.3, 3.0, 4.0])
    figures = against_again(error, away)
    assert figures["determined_percent"] == 50.0
    assert figures["determined_rmse_cm"] == pytest.approx(np.sqrt((9 + 16) / 2))
    assert figures["parted_rmse_cm"] == pytest.approx(np.sqrt((36 + 64) / 2))
    assert figures["parted_error_ratio"] == pytest.approx(2.0)
    assert figures["again_rmse_cm"] == pytest.approx(np.sqrt((0.09 + 9 + 16) / 4))


def test_where_there_is_no_such_frame_there_is_no_figure():
    never = against_again(np.ones(3), np.zeros(3))
    assert never["determined_rmse_cm"] == 1.0
    assert never["parted_rmse_cm"] is None
    assert never["parted_error_ratio"] is None
    assert against_again(np.ones(3), np.ones(3))["determined_rmse_cm"] is None
