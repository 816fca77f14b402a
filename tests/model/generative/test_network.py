import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.config import GenerativeConfig
from garment_jax.model.generative.network import decode, encode, init_generative, position_map
from tests.reference.small_model import GENERATIVE, SIZE, small_model

PLAIN = dataclasses.replace(
    GENERATIVE, linear_skip=False, instance_norm=False, map_statistics=False, rec_rank=0
)


@pytest.mark.parametrize("config", [GENERATIVE, PLAIN], ids=["default", "paper"])
@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_shapes(config, batch):
    model = small_model()
    n = len(model.template.T)
    options = {"template": model.template, "config": config}
    params = jax.eval_shape(
        lambda key: init_generative(key, model.template, config=config), jax.random.key(0)
    )
    V = jax.ShapeDtypeStruct((*batch, n, 3), jnp.float32)
    code = jax.eval_shape(lambda p, V: encode(p, V, **options), params, V)
    assert [leaf.shape for leaf in code] == [(*batch, 8)] * 2
    decoded = jax.eval_shape(lambda p, Z: decode(p, Z, **options), params, code.mean)
    assert [leaf.shape for leaf in decoded] == [(*batch, n, 3)] * 3


def test_another_number_of_vertices_is_refused():
    model = small_model()
    with pytest.raises(ValueError, match=r"V is \[3, 50, 3\] and the template has 60 vertices; give V as"):
        encode(model.params, jnp.asarray(model.V[:3, :50]), template=model.template, config=GENERATIVE)
    with pytest.raises(ValueError, match=r"V is \[1, 3\] and the template has 60 vertices"):
        position_map(jnp.zeros((1, 3)), model.template)


def test_rank_0_leaves_the_last_layer_whole_and_a_rank_factors_it():
    model = small_model()
    shapes = jax.eval_shape(lambda k: init_generative(k, model.template, config=PLAIN), jax.random.key(0))
    assert shapes["D_rec"]["basis"]["kernel"].shape == (12, 3 * 60)
    assert model.params["D_rec"]["basis"]["kernel"].shape == (10, 3 * 60)


def test_the_garment_is_the_unposed_one_plus_its_dynamic_offset_in_metres():
    model = small_model()
    Z = jnp.asarray(np.random.default_rng(0).normal(size=(2, 8)), jnp.float32)
    run = jax.jit(lambda params, Z: decode(params, Z, template=model.template, config=GENERATIVE))
    decoded = run(model.params, Z)
    np.testing.assert_allclose(decoded.V, decoded.T_tilde + decoded.I_dyn, atol=1e-7)
    # no weights, a bias of 1 cm: the template moves by 1 cm along every axis, and so does the offset
    bare = jax.tree.map(jnp.zeros_like, model.params)
    bare["D_rec"]["basis"]["bias"] += 1.0
    bare["D_dyn"]["skip"]["bias"] += 2.0
    decoded = run(bare, Z)
    np.testing.assert_allclose(decoded.T_tilde[0], model.template.T + 0.01, atol=1e-6)
    np.testing.assert_allclose(decoded.I_dyn, 0.02, atol=1e-6)


def test_a_batch_is_decoded_and_encoded_one_by_one():
    model = small_model()
    options = {"template": model.template, "config": GENERATIVE}
    V = jnp.asarray(model.V[:3])
    together = jax.jit(lambda p, V: encode(p, V, **options))(model.params, V)
    alone = jax.jit(lambda p, V: encode(p, V, **options))(model.params, V[1])
    for a, b in zip(together, alone, strict=True):
        np.testing.assert_allclose(a[1], b, atol=1e-4)


def test_the_position_map_is_normalised_by_the_training_sets_statistics():
    model = small_model()
    mean, std = model.template.statistics[:2]
    V = jnp.asarray(
        np.stack([np.broadcast_to(mean, model.V[0].shape), mean + std * np.ones_like(model.V[0])])
    )
    S = position_map(V, model.template)
    assert S.shape == (2, SIZE, SIZE, 3)
    np.testing.assert_allclose(S[0], 0, atol=1e-5)
    np.testing.assert_allclose(S[1], 1, atol=1e-5)


def test_a_wild_log_variance_is_clipped():
    model = small_model()
    params = jax.tree.map(jnp.zeros_like, model.params)
    params["E_gen"]["Dense_0"]["bias"] = jnp.concatenate([jnp.zeros(8), jnp.full(4, 1e6), jnp.full(4, -1e6)])
    code = jax.jit(lambda p, V: encode(p, V, template=model.template, config=GENERATIVE))(params, model.V[0])
    assert np.exp(code.log_variance).max() < 100
    assert code.log_variance.min() == -20


def test_every_network_draws_from_a_key_of_its_own():
    params = small_model().params
    assert np.abs(params["split_s"]["kernel"] - params["split_d"]["kernel"]).min() > 0


def test_the_defaults_are_the_papers_sizes():
    config = GenerativeConfig()
    assert (config.latent_dim, config.part_dim, len(config.channels)) == (128, 64, 4)
