"""How evenly a row of shapes changes, against closed forms."""

import numpy as np
import pytest

from garment_jax.bench.latent import smoothness


def test_a_straight_and_even_path_has_no_second_difference() -> None:
    start = np.random.default_rng(0).normal(size=(5, 3))
    move = np.array([0.003, 0.0, 0.004])  # 5 mm
    found = smoothness(start + np.arange(7)[:, None, None] * move)
    assert found.step_mm == pytest.approx(5.0)
    assert found.bend_mm == pytest.approx(0.0, abs=1e-9)
    assert found.ratio == pytest.approx(0.0, abs=1e-9)


def test_a_circle_bends_by_its_angle() -> None:
    angle = 0.2 * np.arange(9)
    shapes = np.stack([np.cos(angle), np.sin(angle), np.zeros(9)], axis=-1)[:, None]
    found = smoothness(shapes)
    chord = 2 * np.sin(0.1)
    assert found.step_mm == pytest.approx(1e3 * chord)
    assert found.ratio == pytest.approx(chord)  # the second difference is the chord squared


def test_no_movement_is_no_division_by_zero_and_two_shapes_are_refused() -> None:
    assert smoothness(np.ones((4, 2, 3))) == (0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="2 shapes have no second difference"):
        smoothness(np.ones((2, 2, 3)))
