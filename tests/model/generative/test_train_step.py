import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from garment_jax.model.generative.train_step import (
    GenerativeBatch,
    generative_loss,
    make_generative_train_step,
)
from garment_jax.structs import TrainState
from tests.reference.small_model import GENERATIVE, fast_key, small_model

OPTIMISER = optax.adam(1e-2)


def batch() -> GenerativeBatch:
    model = small_model()
    return GenerativeBatch(jnp.asarray(model.V[:4]), jnp.asarray(model.T_tilde[:4]))


@pytest.fixture(scope="module")
def step():
    """The train step, from parameters and a key's seed, so that every test starts where it likes."""
    compiled = make_generative_train_step(small_model().template, GENERATIVE, OPTIMISER)

    def run(params: dict, seed: int, steps: int = 1) -> tuple[TrainState, list[dict[str, float]]]:
        params = jax.tree.map(jnp.array, params)  # a copy: the step donates
        state = TrainState(params, OPTIMISER.init(params), fast_key(seed), jnp.int32(0))
        metrics = []
        for _ in range(steps):
            state, found = compiled(state, batch())
            metrics.append({name: float(value) for name, value in found.items()})
        return state, metrics

    return run


def test_one_batch_is_overfitted_and_the_loss_is_the_sum_of_its_logged_terms(step):
    state, metrics = step(small_model().params, 1, 100)
    assert state.step == 100
    assert metrics[0]["rmse_cm"] > 5
    assert metrics[-1]["vertex"] < 0.1 * metrics[0]["vertex"]
    assert metrics[-1]["loss"] < 0.3 * metrics[0]["loss"]  # the decoded template's terms have a floor
    for found in metrics[::20]:
        terms = ("vertex", "laplacian", "unposed", "template", "kl")
        assert found["loss"] == pytest.approx(sum(found[name] for name in terms), rel=1e-5)
        assert found["rmse_cm"] == pytest.approx(np.sqrt(found["vertex"]), rel=1e-4)


def test_live_dimensions_are_those_above_a_hundredth_of_a_nat(step):
    params = jax.tree.map(jnp.zeros_like, small_model().params)
    # a mean of m and a deviation of 1 carry m^2 / 2 nats: 0.005, 0.02 and 2
    params["E_gen"]["Dense_0"]["bias"] = jnp.zeros(16).at[jnp.array([1, 2, 3])].set(jnp.array([0.1, 0.2, 2]))
    assert step(params, 0)[1][0]["live_dimensions"] == 2


def test_the_key_decides_the_sample_and_nothing_else(step):
    first, again, other = (step(small_model().params, seed)[1][0] for seed in (0, 0, 1))
    assert first == again
    assert first["loss"] != other["loss"]
    assert first["kl"] == other["kl"]


def test_a_dead_model_has_finite_gradients(step):
    state, metrics = step(jax.tree.map(jnp.zeros_like, small_model().params), 0)
    assert np.isfinite(metrics[0]["gradient_norm"])
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(state.params))


def test_input_noise_enters_the_encoder():
    model = small_model()
    config = dataclasses.replace(GENERATIVE, input_noise=0.05)

    @jax.jit
    def kl(key: jax.Array) -> jax.Array:
        return generative_loss(model.params, key, batch(), template=model.template, config=config)[1]["kl"]

    assert kl(fast_key(0)) != kl(fast_key(1))
