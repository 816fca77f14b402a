"""Parameters that are not those of the networks that a configuration describes."""

from typing import Any

import jax
import numpy as np
import pytest

from garment_jax.animation.animate import _blaming
from garment_jax.model.misfit import check_parameters
from garment_jax.model.store import Model
from tests.animation.tiny_model import template, tiny_model


def changed(kernel: np.ndarray | None) -> Model:
    """Return the tiny model with another kernel of its detail, or without it."""
    params = jax.tree.map(lambda leaf: leaf, tiny_model().params)
    del params["detail"]["code_0"]["kernel"]
    params["detail"]["code_0"] |= {} if kernel is None else {"kernel": kernel}
    return tiny_model()._replace(params=params)


def test_a_misfit_is_named_and_an_encoder_that_is_left_out_is_none():
    check_parameters(tiny_model(), template())
    lacking = changed(None)
    del lacking.params["generative"]["E_gen"]
    with pytest.raises(ValueError, match=r"lack detail/code_0/kernel, which config\.toml asks for; copy"):
        check_parameters(lacking, template())


def test_an_animation_that_fails_of_it_says_so():
    """In one sentence, where jax tells of shapes in its own words; other faults stay what they are."""

    def failing() -> Any:
        yield np.ones((3, 4)) @ np.ones(3)

    with pytest.raises(ValueError, match=r"detail/code_0/kernel has shape \(3, 4\), and config.toml asks"):
        next(_blaming(failing(), changed(np.ones((3, 4))), template()))
    with pytest.raises(ValueError, match="matmul"):
        next(_blaming(failing(), tiny_model(), template()))
