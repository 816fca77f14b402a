"""The patch discriminator: its scales, what it sees, what it refuses."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.config import DetailConfig
from garment_jax.dataset.template import make_template
from garment_jax.model.detail.discriminator import (
    PatchDiscriminator,
    discriminate,
    discriminator_map,
    init_discriminator,
)
from garment_jax.model.generative.network import position_map
from tests.model.detail.small_detail import CONFIG, small_batch, small_players, small_template
from tests.reference.small_model import fast_key, small_model


@pytest.mark.parametrize(("size", "sides"), [(256, (64, 32, 16)), (64, (16, 8, 4)), (32, (8, 4, 2))])
def test_three_scales(size, sides):
    S = jax.ShapeDtypeStruct((2, size, size, 6), jnp.float32)
    module = PatchDiscriminator(DetailConfig().channels)
    scores, params = jax.eval_shape(lambda S: module.init_with_output(fast_key(0), S), S)
    assert [score.shape for score in scores] == [(2, side, side) for side in sides]
    assert sum(name.startswith("Dense") for name in params["params"]) == 3


def test_scores_are_finite_and_differ_from_garment_to_garment():
    config = dataclasses.replace(CONFIG, channels=(4, 6, 6))  # half the time to compile
    batch, D = small_batch(), small_players(config)["D"]
    judge = jax.jit(lambda V: discriminate(D, V, template=small_template(), config=config))
    scores = judge(batch.V_star)
    assert [score.shape for score in scores] == [(4, side, side) for side in (8, 4)]
    for score in scores:
        assert np.isfinite(score).all()
        assert np.asarray(score).std(axis=0).max() > 1e-3


def test_wrinkles_are_of_order_one_in_its_map_and_the_paper_s_map_has_none_of_it():
    V, template = jnp.asarray(small_model().V), small_template()
    S = discriminator_map(V, template=template, config=CONFIG)
    assert S.shape[-1] == 6
    np.testing.assert_array_equal(S[..., :3], position_map(V, template))
    # mirrored test garment: 3 folds of 2 cm on edges of 12 cm are coarser than simulated cloth
    assert 0.1 < S[..., 3:].std() < 10
    paper = dataclasses.replace(CONFIG, wrinkle_map=False)
    np.testing.assert_array_equal(
        discriminator_map(V, template=template, config=paper), position_map(V, template)
    )


@pytest.mark.parametrize(("size", "channels"), [(16, (4, 6, 6, 8)), (32, (4,)), (40, (4, 6, 6, 8))])
def test_maps_too_small_or_odd_are_refused(size, channels):
    model = small_model()
    template = make_template(model.scene.garment, model.scene.body, model.template.statistics, uv_size=size)
    config = dataclasses.replace(CONFIG, channels=channels)
    with pytest.raises(ValueError, match=rf"uv\.size = {size} and {len(channels)} convolutions .* = 0\."):
        init_discriminator(fast_key(0), template, config=config)
