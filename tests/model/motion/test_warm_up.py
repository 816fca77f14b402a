from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.model.generative.network import decode
from garment_jax.model.motion.train_step import empty_carry, motion_loss
from garment_jax.model.motion.warm_up import (
    WarmUpBatch,
    empty_warm_up_carry,
    fit_linear_garment,
    pooled_map,
    warm_up_loss,
)
from tests.reference.motion_window import LANES, frozen, motion_params, window
from tests.reference.small_model import GENERATIVE, MOTION, fast_key, small_model


def test_the_linearised_loop_is_the_full_one_where_decoder_and_state_encoder_are_linear():
    model, (decoder, _) = small_model(), frozen()
    template = model.template
    decoded = jax.jit(lambda Z: decode(decoder, Z, template=template, config=GENERATIVE).V)
    Z = np.random.default_rng(0).normal(size=(30, 8)).astype(np.float32)
    linear = fit_linear_garment(Z, np.asarray(decoded(Z)), template=template, lambda_laplacian=1.5)
    params = jax.tree.map(jnp.array, motion_params())
    params["E_s"]["Dense_0"]["kernel"] *= 0  # the convolutions of E_s, which the warm-up leaves out
    batch = window()
    batch = batch._replace(V_star=decoded(batch.Z_star.reshape(-1, 8)).reshape(batch.V_star.shape))
    whole = partial(motion_loss, template=template, config=MOTION, generative=GENERATIVE)
    carry = empty_carry(LANES, model.V.shape[1], MOTION)
    _, (full, terms) = jax.jit(whole)(params, decoder, fast_key(0), carry, batch)
    small = WarmUpBatch(batch.x, batch.Z_star, batch.weight, batch.fresh, pooled_map(batch.V_start, template))
    quick = partial(warm_up_loss, linear=linear, template=template, config=MOTION)
    _, (warm, found) = jax.jit(quick)(params, fast_key(0), empty_warm_up_carry(LANES, linear, MOTION), small)
    assert found["geometry"] == pytest.approx(float(terms["vertex"] + terms["laplacian"]), rel=1e-2)
    assert found["latent"] == pytest.approx(float(terms["latent"]), rel=1e-2)
    np.testing.assert_allclose(warm.h, full.h, atol=2e-3)
    np.testing.assert_allclose(warm.pooled, pooled_map(full.V_prev, template), atol=2e-3)
