"""The detail generator: shapes, its parts, its cut input, its two departures."""

import dataclasses
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.config import DetailConfig
from garment_jax.model.detail.network import (
    detail_offset,
    enhance,
    global_features,
    init_detail,
    local_features,
    mean_edge,
)
from tests.model.detail.small_detail import CONFIG, small_batch, small_template
from tests.reference.small_model import GENERATIVE, fast_key

PAPER = dataclasses.replace(CONFIG, hidden=0, vertex_code=0)
TEMPLATE = small_template()
N = len(TEMPLATE.T)


def fresh(config: DetailConfig) -> dict:
    return jax.jit(lambda key: init_detail(key, TEMPLATE, config=config, generative=GENERATIVE))(fast_key(0))


@lru_cache
def awake(config: DetailConfig) -> dict:
    """Fresh parameters whose last layer is not near zero."""
    params = fresh(config)
    return {**params, "out": jax.tree.map(lambda x: 1e4 * x, params["out"])}


@lru_cache
def offset_of(config: DetailConfig):
    """`detail_offset`, compiled once for all tests."""
    return jax.jit(lambda p, V, Z: detail_offset(p, V, Z, template=TEMPLATE, config=config))


@pytest.mark.parametrize("config", [CONFIG, PAPER], ids=["default", "paper"])
@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_shapes(config, batch):
    V, Z = jax.ShapeDtypeStruct((*batch, N, 3), jnp.float32), jax.ShapeDtypeStruct((*batch, 8), jnp.float32)
    params = jax.eval_shape(
        lambda key: init_detail(key, TEMPLATE, config=config, generative=GENERATIVE), fast_key(0)
    )
    found = jax.eval_shape(lambda p, V, Z: enhance(p, V, Z, template=TEMPLATE, config=config), params, V, Z)
    assert found.shape == (*batch, N, 3)


def test_the_paper_s_widths_are_3_8_10_and_two_dense_layers():
    params = jax.eval_shape(
        lambda key: init_detail(key, TEMPLATE, config=DetailConfig(), generative=GENERATIVE), fast_key(0)
    )
    kernels = {name: leaf["kernel"].shape for name, leaf in params.items() if name != "vertex_code"}
    assert kernels["edge_0"] == (6, 8)
    assert kernels["edge_1"] == (16, 10)
    assert (kernels["code_0"], kernels["code_1"]) == ((8, 64), (64, 32))
    assert kernels["hidden"] == (10 + 32 + 8, 32)
    assert set(fresh(PAPER)) == {"edge_0", "edge_1", "code_0", "code_1", "out"}


def test_training_begins_from_no_detail():
    V, Z, _ = small_batch()
    offset = offset_of(CONFIG)(fresh(CONFIG), V, Z)
    assert 0 < jnp.abs(offset).max() < 1e-5  # metres


@pytest.mark.parametrize("config", [CONFIG, PAPER], ids=["default", "paper"])
def test_parts_multiplied_apart_equal_their_concatenation(config):
    params, (V, Z, _) = awake(config), small_batch()
    local = jnp.moveaxis(local_features(params, V, template=TEMPLATE, config=config), 0, -1)
    shared = jnp.moveaxis(global_features(params, Z, config=config), 0, -1)  # [B, 1, g]
    parts = [local, jnp.broadcast_to(shared, (*local.shape[:-1], shared.shape[-1]))]
    if config.vertex_code:
        parts.append(jnp.broadcast_to(params["vertex_code"][None], (*local.shape[:-1], config.vertex_code)))
    x = np.concatenate([np.asarray(part) for part in parts], axis=-1)
    for name in ("hidden", "out") if config.hidden else ("out",):
        x = x @ np.asarray(params[name]["kernel"]) + np.asarray(params[name]["bias"])
        if name == "hidden":
            x = np.where(x > 0, x, 0.2 * x)
    found = offset_of(config)(params, V, Z)
    np.testing.assert_allclose(found, 0.01 * x, rtol=1e-4, atol=1e-6)


def test_a_batch_equals_one_by_one():
    params, (V, Z, _) = awake(CONFIG), small_batch()
    whole = offset_of(CONFIG)(params, V, Z)
    single = [offset_of(CONFIG)(params, v, z) for v, z in zip(V, Z, strict=True)]
    np.testing.assert_allclose(whole, np.stack(single), atol=1e-6)


def test_the_garment_is_its_input_plus_the_offset():
    params, (V, Z, _) = awake(CONFIG), small_batch()
    offset = offset_of(CONFIG)(params, V, Z)
    assert jnp.abs(offset).max() > 1e-3
    V_f = jax.jit(lambda p: enhance(p, V, Z, template=TEMPLATE, config=CONFIG))(params)
    np.testing.assert_allclose(V_f, V + offset, atol=1e-6)


def test_no_gradient_reaches_the_input_and_some_reaches_every_parameter():
    params, (V, Z, _) = awake(CONFIG), small_batch()

    def size(params, V, Z):
        return jnp.square(detail_offset(params, V, Z, template=TEMPLATE, config=CONFIG)).sum()

    to_params, to_V, to_Z = jax.jit(jax.grad(size, argnums=(0, 1, 2)))(params, V, Z)
    assert not np.asarray(to_V).any()
    assert not np.asarray(to_Z).any()
    for leaf in jax.tree.leaves(to_params):
        assert np.abs(leaf).max() > 0


def test_inputs_are_of_order_one():
    params, (V, _, _) = awake(CONFIG), small_batch()
    x = (V - jnp.broadcast_to(TEMPLATE.statistics.map_mean, V.shape)) / 0.1
    assert 0.5 < x.std() < 3
    index, mask = TEMPLATE.neighbours
    differences = np.linalg.norm(TEMPLATE.T[index] - TEMPLATE.T[:, None], axis=-1)[mask > 0]
    assert (differences / mean_edge(TEMPLATE)).mean() == pytest.approx(1.0, rel=1e-5)
    features = local_features(params, V, template=TEMPLATE, config=CONFIG)
    assert 0.3 < features.std() < 10


def test_the_code_moves_all_vertices_alike_without_the_departures():
    # Why they exist: in the paper's form the code's part of I_de is one vector for the whole garment.
    V, Z, _ = small_batch()

    def spread(config):
        a, b = (offset_of(config)(awake(config), V[0], z) for z in Z[:2])
        return float((a - b).std(axis=0).max() / jnp.abs(a - b).max())

    assert spread(PAPER) < 1e-4
    assert spread(CONFIG) > 0.01
