"""The ablation with one decoder: it begins as principal components; no term of the loss is unposed."""

import hashlib
import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.config import Config, GenerativeConfig, apply_overrides, content_hash, to_dict
from garment_jax.dataset.template import Template
from garment_jax.geometry.uv_maps import from_map, to_map
from garment_jax.model.generative.losses import generative_terms
from garment_jax.model.generative.network import Code, decode, encode, init_generative
from garment_jax.model.generative.principal import begin_linear
from garment_jax.model.store import template_for
from tests.animation.tiny_model import CONFIG, SCENE, tiny_model

ONE: GenerativeConfig = replace(CONFIG.generative, decomposition=False, latent_dim=6)

LATER = ("lengths", "column_rnn")  # of [rollout], all of them later ones


@pytest.fixture(scope="module")
def template() -> Template:
    return template_for(tiny_model(), SCENE, "x")[0]


def frames(template: Template, count: int = 40) -> np.ndarray:
    """Garments of four smooth modes."""
    rng = np.random.default_rng(0)
    modes = 0.1 * np.sin(template.T @ rng.normal(size=(3, 4)) * 4)[:, :, None] * rng.normal(size=(4, 3))
    return (template.T + np.einsum("fk,nkc->fnc", rng.normal(size=(count, 4)), modes)).astype(np.float32)


def begun(template: Template, config: GenerativeConfig = ONE) -> dict:
    V = frames(template)
    params = init_generative(jax.random.key(0), template, config=config)
    return begin_linear(params, V, V, template=template, config=config)


def test_there_is_one_decoder_and_it_begins_as_principal_components(template: Template) -> None:
    params, V = begun(template), jnp.asarray(frames(template)[:5])
    assert set(params) == {"E_gen", "D_dyn"}
    code = jax.jit(lambda V: encode(params, V, template=template, config=ONE))(V)
    rebuilt = jax.jit(lambda Z: decode(params, Z, template=template, config=ONE))(code.mean)
    # as far as a map of this size holds a garment
    through_map = jax.jit(lambda V: from_map(to_map(V, template.atlas), template.atlas))(V)
    error = np.linalg.norm(rebuilt.V - through_map, axis=-1)
    assert np.sqrt(np.square(error).mean()) < 0.15 * np.asarray(V).std(axis=0).mean()
    np.testing.assert_array_equal(rebuilt.T_tilde, jnp.broadcast_to(template.T, V.shape))


def test_no_term_compares_unposed_garments(template: Template) -> None:
    V = jnp.asarray(frames(template)[:2])
    code = Code(jnp.zeros((2, 6)), jnp.zeros((2, 6)))
    decoded = decode(begun(template), code.mean, template=template, config=ONE)
    terms = generative_terms(code, decoded, V, V, template=template, config=ONE)
    assert set(terms) == {"vertex", "laplacian", "kl"}


def test_without_a_kl_term_the_start_is_finite(template: Template) -> None:
    for leaf in jax.tree.leaves(begun(template, replace(ONE, lambda_kl=0.0))):
        assert np.isfinite(leaf).all()


def test_hashes_from_before_the_key_hold() -> None:
    older = to_dict(Config())
    del older["generative"]["decomposition"], older["generative"]["skin_reach"]
    del older["baselines"], older["column_rnn"], older["simulation"]
    del older["training"]["begin_from"], older["training"]["average"]
    for key in LATER:
        del older["rollout"][key]
    del older["collision"]["untangle"]

    text = json.dumps(older, sort_keys=True).encode()
    assert content_hash(Config()) == hashlib.sha256(text).hexdigest()[:16]
    changes = ("--generative.decomposition=false", "--baselines.bones=7", "--column_rnn.steps=7")
    changes += ("--rollout.column_rnn=0.7",)
    for change in (*changes, "--training.begin_from=models/skirt"):
        assert content_hash(apply_overrides(Config(), [change])) != content_hash(Config())


def test_hashes_of_column_rnns_from_before_their_keys_hold() -> None:
    has_column_rnn = apply_overrides(Config(), ["--column_rnn.steps=7"])
    older = to_dict(has_column_rnn)
    for key in ("layers", "previous_state", "dropout", "motion_noise"):
        del older["column_rnn"][key]
    del older["generative"]["decomposition"], older["generative"]["skin_reach"]
    del older["baselines"], older["simulation"]
    del older["training"]["begin_from"], older["training"]["average"]
    for key in LATER:
        del older["rollout"][key]
    del older["collision"]["untangle"]
    older["swing"] = older.pop("column_rnn")  # its name then
    text = json.dumps(older, sort_keys=True).encode()
    assert content_hash(has_column_rnn) == hashlib.sha256(text).hexdigest()[:16]
    for change in ("layers=1", "previous_state=false", "dropout=0.1", "motion_noise=0.1"):
        assert content_hash(apply_overrides(has_column_rnn, [f"--column_rnn.{change}"])) != content_hash(
            has_column_rnn
        )
