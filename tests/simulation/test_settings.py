"""Settings: the measured defaults, what is refused, and the line that goes into files."""

from dataclasses import fields

import pytest

from garment_jax.simulation.settings import ClothSettings


def test_a_frame_is_divided_into_substeps():
    assert ClothSettings(fps=25.0, substeps=4).substep == pytest.approx(0.01)


@pytest.mark.parametrize("name", ["substeps", "density", "stretch", "particle_radius", "fps"])
@pytest.mark.parametrize("value", [0, -1])
def test_what_cannot_be_simulated_is_refused(name: str, value: float):
    with pytest.raises(ValueError, match=rf"{name}={value} must be more than 0; the default is "):
        ClothSettings(**{name: value})


def test_no_number_is_refused():
    with pytest.raises(ValueError, match="bend=nan must be 0 or more"):
        ClothSettings(bend=float("nan"))


@pytest.mark.parametrize("name", ["bend", "bend_bias", "friction", "settle", "blend", "hold", "drag"])
def test_what_may_be_nothing_may_not_be_negative(name: str):
    assert getattr(ClothSettings(**{name: 0}), name) == 0
    with pytest.raises(ValueError, match=f"{name}=-1 must be 0 or more"):
        ClothSettings(**{name: -1})


def test_the_description_names_every_setting_and_tells_two_apart():
    line = ClothSettings(air=False, bend=5e-4).describe()
    assert all(field.name in line for field in fields(ClothSettings))
    assert "air off" in line
    assert "bend 0.0005" in line
    assert line != ClothSettings().describe()
