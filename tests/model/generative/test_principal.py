import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.model.generative.network import decode, encode
from garment_jax.model.generative.principal import begin_linear, fit_linear_model, split_parts
from tests.reference.laplacian import uniform_laplacian
from tests.reference.small_model import GENERATIVE, small_model


@pytest.fixture(scope="module")
def begun():
    """The model, its parameters begun from its frames, and jitted encode and decode."""
    model = small_model()
    params = begin_linear(model.params, model.V, model.T_tilde, template=model.template, config=GENERATIVE)
    options = {"template": model.template, "config": GENERATIVE}
    return (
        model,
        params,
        jax.jit(lambda V: encode(params, V, **options)),
        jax.jit(lambda Z: decode(params, Z, **options)),
    )


def principal_error(V: np.ndarray, rank: int) -> float:
    """RMSE in cm of the projection on `rank` principal components."""
    flat = V.reshape(len(V), -1).astype(float)
    singular = np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)
    return 100 * np.sqrt((singular[rank:] ** 2).sum() / (V.shape[0] * V.shape[1]))


def rmse(V: np.ndarray, V_star: np.ndarray) -> float:
    return 100 * np.sqrt(np.square(np.asarray(V) - V_star).sum(axis=-1).mean())


def test_components_are_those_of_the_svd_and_the_scores_are_white():
    model = small_model()
    linear = fit_linear_model(model.V, model.T_tilde, 8)
    np.testing.assert_allclose(linear.Z.T @ linear.Z / len(model.V), np.eye(8), atol=1e-4)
    rebuilt = (linear.mean_V + linear.Z @ linear.V_modes.T).reshape(model.V.shape)
    assert rmse(rebuilt, model.V) == pytest.approx(principal_error(model.V, 8), rel=1e-3)
    # T_tilde's modes are its regression on the scores
    flat = model.T_tilde.reshape(len(model.V), -1)
    design = np.column_stack([linear.Z, np.ones(len(model.V))])
    expected = np.linalg.lstsq(design, flat, rcond=None)[0][:8].T
    np.testing.assert_allclose(linear.T_tilde_modes, expected, atol=1e-4)


def test_too_few_frames_are_refused():
    model = small_model()
    with pytest.raises(ValueError, match="8 training frames cannot fill 8 latent dimensions; add clips"):
        fit_linear_model(model.V[:8], model.T_tilde[:8], 8)


def test_two_parts_of_enough_rank_explain_both_exactly_and_of_less_as_well_as_any():
    model = small_model()
    linear = fit_linear_model(model.V, model.T_tilde, 8)
    P_s, A_s, P_d, A_d = split_parts(linear, 8, 0.1)
    np.testing.assert_allclose(P_s @ A_s + P_d @ A_d, linear.V_modes, atol=1e-5)
    np.testing.assert_allclose(P_s @ A_s, linear.T_tilde_modes, atol=1e-4)
    P_s, A_s, P_d, A_d = split_parts(linear, 3, 0.1)
    assert P_s.shape == P_d.shape == (180, 3)
    left = np.linalg.norm(P_s @ A_s + P_d @ A_d - linear.V_modes)
    best = np.linalg.norm(np.linalg.svd(linear.V_modes, compute_uv=False)[6:])  # six modes in all
    assert best <= left < 3 * best + 1e-6


def test_it_reconstructs_training_frames_about_as_well_as_principal_components(begun):
    model, _, encoded, decoded = begun
    pca = principal_error(model.V, 8)
    rebuilt = decoded(encoded(jnp.asarray(model.V)).mean)
    untrained = rmse(np.broadcast_to(model.V.mean(axis=0), model.V.shape), model.V)
    assert rmse(rebuilt.V, model.V) < 1.2 * pca + 0.02  # cm
    assert rmse(rebuilt.V, model.V) < 0.2 * untrained
    assert rmse(rebuilt.T_tilde, model.T_tilde) < 0.5 * rmse(
        np.broadcast_to(model.T_tilde.mean(axis=0), model.V.shape), model.T_tilde
    )


def test_the_code_begins_as_the_whitened_scores(begun):
    model, _, encoded, _ = begun
    linear = fit_linear_model(model.V, model.T_tilde, 8)
    np.testing.assert_allclose(encoded(jnp.asarray(model.V)).mean, linear.Z, atol=0.1)


def test_the_code_begins_with_the_variance_at_which_kl_and_sampling_error_balance(begun):
    # lambda / 2 (s - log s) + g s is least at s = lambda / (lambda + 2 g), g the loss that unit noise adds
    model, _, encoded, decoded = begun
    s = np.exp(encoded(jnp.asarray(model.V[:1])).log_variance[0])
    away = np.asarray(decoded(jnp.concatenate([jnp.eye(8), jnp.zeros((1, 8))])).V)
    for k, mode in enumerate(away[:-1] - away[-1]):
        rough = uniform_laplacian(mode.astype(float), model.scene.garment.faces)
        g = 1e4 * (np.square(mode).sum() + 3.5 * np.square(rough).sum()) / len(mode)
        assert s[k] == pytest.approx(1e-3 / (1e-3 + 2 * g), rel=0.2)


def test_a_rank_below_the_part_is_refused():
    model = small_model()
    short = jax.tree.map(lambda x: x, model.params)
    short["D_rec"]["basis"] = {**short["D_rec"]["basis"], "kernel": jnp.zeros((3, 180))}
    with pytest.raises(ValueError, match=r"rec_rank = 3 is less than part_dim = 6; raise it"):
        begin_linear(short, model.V, model.T_tilde, template=model.template, config=GENERATIVE)


def test_the_given_parameters_are_left_alone(begun):
    model, params, _, _ = begun
    assert np.abs(model.params["D_dyn"]["skip"]["bias"]).max() == 0
    assert np.abs(params["D_dyn"]["skip"]["bias"]).max() > 0
