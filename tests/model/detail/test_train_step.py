"""Both players on one batch: overfitted, kept apart, and alone without an adversarial term."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from garment_jax.model.detail.discriminator import discriminate
from garment_jax.model.detail.losses import adversarial_term, detail_terms, discriminator_loss
from garment_jax.model.detail.network import enhance
from garment_jax.model.detail.train_step import make_detail_train_step, players_loss, side_by_side
from garment_jax.structs import TrainState
from tests.model.detail.small_detail import CONFIG, small_batch, small_players, small_template
from tests.reference.small_model import fast_key

STEPS = 400
# one scale and the paper's map: a third of the time to compile
TWO = dataclasses.replace(CONFIG, channels=(4, 6), wrinkle_map=False)
ALONE = dataclasses.replace(CONFIG, lambda_adversarial=0.0)
LEAST = dataclasses.replace(TWO, features=(4,), code_features=(4,), hidden=0, vertex_code=0)
OPTIMISER = side_by_side({"G": optax.adam(5e-3), "D": optax.adam(2e-4)})


def begin(config):
    params = small_players(config)
    return TrainState(params, OPTIMISER.init(params), fast_key(0), jnp.int32(0))


@pytest.fixture(scope="module")
def trained():
    """Some hundred steps on one batch: last state and every 50th step's metrics."""
    state, batch, metrics = begin(TWO), small_batch(), []
    step = make_detail_train_step(small_template(), TWO, OPTIMISER)
    for k in range(STEPS):
        state, found = step(state, batch)
        if k % 50 == 0 or k == STEPS - 1:
            metrics.append({name: float(value) for name, value in found.items()})
    return state, metrics


def test_one_batch_is_overfitted(trained):
    state, metrics = trained
    assert state.step == STEPS
    assert metrics[0]["rmse_cm"] == pytest.approx(metrics[0]["rmse_before_cm"], rel=1e-2)
    assert metrics[-1]["rmse_cm"] < 0.4 * metrics[-1]["rmse_before_cm"]


def test_the_generator_s_loss_is_the_sum_of_its_logged_terms(trained):
    for metrics in trained[1]:
        terms = ("vertex", "laplacian", "adversarial")
        assert metrics["loss"] == pytest.approx(sum(metrics[name] for name in terms), rel=1e-5)


def test_the_discriminator_learns_and_its_scores_are_logged(trained):
    first, last = trained[1][0], trained[1][-1]
    assert last["discriminator"] < first["discriminator"]
    assert first["score_real"] == pytest.approx(first["score_fake"], abs=0.5)
    assert {"gradient_norm", "gradient_norm_D"} <= set(first)


def test_without_an_adversarial_term_there_is_no_discriminator():
    step = make_detail_train_step(small_template(), ALONE, OPTIMISER)
    state, metrics = jax.eval_shape(step, jax.eval_shape(lambda: begin(ALONE)), small_batch())
    assert set(state.params) == set(state.opt_state) == {"G"}
    logged = {"vertex", "laplacian", "loss", "rmse_before_cm", "rmse_cm", "gradient_norm"}
    assert set(metrics) == logged


def test_one_gradient_serves_both_players():
    params, batch, options = (
        small_players(LEAST),
        small_batch(),
        {"template": small_template(), "config": LEAST},
    )
    # a generator that changes something, or the two garments would be one
    params["G"]["out"] = jax.tree.map(lambda x: 1e3 * x, params["G"]["out"])

    def judged(D, V):
        return discriminate(D, V, **options)

    def of_D(D, V_f):
        return discriminator_loss(judged(D, batch.V_star), judged(D, V_f))

    def of_G(G, D):
        V_f = enhance(G, batch.V, batch.Z, **options)
        terms = detail_terms(V_f, batch.V_star, **options)
        return sum(terms.values()).mean() + adversarial_term(judged(D, V_f), config=LEAST)

    @jax.jit
    def gradients(params):
        V_f = enhance(params["G"], batch.V, batch.Z, **options)
        both = jax.grad(lambda p: players_loss(p, batch, **options)[0])(params)
        alone = {"G": jax.grad(of_G)(params["G"], params["D"]), "D": jax.grad(of_D)(params["D"], V_f)}
        return both, alone, jax.grad(of_D, argnums=1)(params["D"], V_f)

    both, alone, leak = gradients(params)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-5), both, alone)
    assert np.abs(leak).max() > 1e-3, "D's loss depends on V_f: uncut, it would have changed G's gradient"


def test_each_player_has_an_optimiser_of_its_own():
    optimiser = side_by_side({"G": optax.sgd(1.0), "D": optax.chain(optax.clip_by_global_norm(1.0))})
    params = {"G": jnp.zeros(2), "D": jnp.zeros(2)}
    gradient = {"G": jnp.array([30.0, 40.0]), "D": jnp.array([3.0, 4.0])}
    updates, _ = optimiser.update(gradient, optimiser.init(params), params)
    np.testing.assert_allclose(updates["G"], [-30.0, -40.0])  # no other's clipping
    np.testing.assert_allclose(updates["D"], [0.6, 0.8], rtol=1e-6)  # clipped by its own norm, 5
