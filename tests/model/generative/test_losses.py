import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.model.generative.losses import generative_terms, kl_per_dimension, size_of
from garment_jax.model.generative.network import Code, Decoded
from tests.reference.laplacian import uniform_laplacian
from tests.reference.small_model import GENERATIVE, small_model


def test_size_by_hand():
    # two vertices, 3 cm and 4 cm off: (9 + 16) / 2 cm2, or the norm 5 cm
    E = jnp.array([[0.03, 0, 0], [0, 0, -0.04]])
    assert size_of(E) == pytest.approx(12.5)
    assert size_of(E, "plain") == pytest.approx(5.0)


def test_the_plain_norm_has_a_gradient_of_0_at_0_and_a_finite_one_near_it():
    gradient = jax.grad(lambda E: size_of(E, "plain"))
    np.testing.assert_array_equal(gradient(jnp.zeros((4, 3))), 0)
    tiny = jnp.zeros((4, 3)).at[0, 0].set(1e-12)
    assert np.isfinite(gradient(tiny)).all()
    np.testing.assert_array_equal(jax.grad(lambda E: size_of(E))(jnp.zeros((4, 3))), 0)


def test_kl_of_a_standard_normal_is_0_and_of_others_the_closed_form():
    assert kl_per_dimension(Code(jnp.zeros(5), jnp.zeros(5))).max() == 0
    # KL(N(m, s^2) | N(0, 1)) = (m^2 + s^2 - 1) / 2 - log s, with m = 2, s = 1/2
    code = Code(jnp.array([2.0]), jnp.log(jnp.array([0.25])))
    assert kl_per_dimension(code)[0] == pytest.approx((4 + 0.25 - 1) / 2 + np.log(2))


@pytest.mark.parametrize("norm", ["cm2", "plain"])
def test_every_term_by_hand(norm):
    model = small_model()
    rng = np.random.default_rng(0)
    V_star, V, T_tilde, T_tilde_star = (
        (model.V[0] + rng.normal(0, s, model.V[0].shape)).astype(np.float32) for s in (0, 0.02, 0.1, 0.2)
    )
    mean, log_variance = rng.normal(size=(2, 8)).astype(np.float32)
    config = dataclasses.replace(GENERATIVE, norm=norm)
    terms = jax.jit(partial(generative_terms, template=model.template, config=config))(
        Code(mean, log_variance), Decoded(V, T_tilde, V - T_tilde), V_star, T_tilde_star
    )

    def size(E: np.ndarray) -> float:
        cm = 100 * E.astype(float)
        return (cm**2).sum() / len(cm) if norm == "cm2" else np.sqrt((cm**2).sum())

    faces = model.scene.garment.faces
    rough = uniform_laplacian(V.astype(float), faces) - uniform_laplacian(V_star.astype(float), faces)
    expected = {
        "vertex": size(V - V_star),
        "laplacian": 3.5 * size(rough),
        "unposed": 0.1 * size(T_tilde - T_tilde_star),
        "template": 0.05 * size(T_tilde - model.template.T),
        "kl": 1e-3 * 0.5 * (mean**2 + np.exp(log_variance) - 1 - log_variance).sum(),
    }
    assert terms.keys() == expected.keys()
    for name, value in expected.items():
        assert terms[name] == pytest.approx(value, rel=1e-4), name


def test_a_perfect_reconstruction_has_a_finite_gradient_in_either_norm():
    model = small_model()
    V = jnp.asarray(model.V[0])
    code = Code(jnp.zeros(8), jnp.zeros(8))
    for norm in ("cm2", "plain"):
        config = dataclasses.replace(GENERATIVE, norm=norm)

        def loss(V_hat, config=config):
            decoded = Decoded(V_hat, V_hat, jnp.zeros_like(V))
            return sum(generative_terms(code, decoded, V, V, template=model.template, config=config).values())

        assert np.isfinite(jax.jit(jax.grad(loss))(V)).all()
