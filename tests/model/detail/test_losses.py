"""Losses worked by hand."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.model.detail.losses import (
    adversarial_term,
    detail_terms,
    discriminator_loss,
    fold_depth,
    l1_cm,
    score_error,
)
from tests.model.detail.small_detail import CONFIG, small_template


def test_l1_is_the_mean_over_vertices_of_the_sum_over_axes_in_cm():
    # Two vertices, 0.01 + 0.02 + 0 m and 0 + 0 + 0.03 m: 3 cm and 3 cm; the second frame twice that.
    E = np.array([[0.01, -0.02, 0.0], [0.0, 0.0, 0.03]], np.float32)
    np.testing.assert_allclose(l1_cm(jnp.stack([E, -2 * E])), [3.0, 6.0], rtol=1e-6)


def test_l1_has_no_gradient_at_zero():
    assert not np.asarray(jax.grad(lambda E: l1_cm(E))(jnp.zeros((5, 3)))).any()


def test_a_translation_costs_its_vertices_and_no_laplacian():
    # 1 cm along each axis: |1| + |1| + |1| = 3 cm on every vertex. The Laplacian of a constant is 0.
    template = small_template()
    V_star = jnp.asarray(template.T)
    terms = detail_terms(V_star + 0.01, V_star, template=template, config=CONFIG)
    assert terms["vertex"] == pytest.approx(3.0, rel=1e-4)
    assert terms["laplacian"] == pytest.approx(0.0, abs=1e-4)


def test_one_moved_vertex_counts_in_its_own_laplacian_and_in_its_neighbours():
    # Vertex i up by 1 cm: its own Laplacian -1 cm, that of each neighbour j +1 / valence_j; over n vertices.
    template = small_template()
    n, i = len(template.T), 7
    index, mask = template.neighbours
    around = sum(1.0 / mask[j].sum() for j in index[i][mask[i] > 0])
    E = jnp.zeros((n, 3)).at[i, 1].set(0.01)
    config = dataclasses.replace(CONFIG, lambda_laplacian=2.0)
    terms = detail_terms(E, jnp.zeros((n, 3)), template=template, config=config)
    assert terms["vertex"] == pytest.approx(1.0 / n, rel=1e-5)
    assert terms["laplacian"] == pytest.approx(2.0 * (1.0 + around) / n, rel=1e-4)


def test_fold_depth_equals_dense_matrices():
    # the same by matrices made of the neighbour lists: bands of the interior's Laplacian, local power, root
    template = small_template()
    index, mask = template.neighbours
    n = len(template.T)
    M = np.zeros((n, n))
    for i in range(n):
        M[i, index[i][mask[i] > 0]] = 1.0 / mask[i].sum()
    S, inner = (np.eye(n) + M) / 2, template.interior.astype(float)[:, None]
    assert 0 < template.interior.sum() < n
    V = np.random.default_rng(0).normal(0, 0.01, (2, n, 3))
    found = np.asarray(fold_depth(jnp.asarray(V, jnp.float32), template=template))
    for k in range(2):
        x = inner * (100 * (M - np.eye(n)) @ V[k])
        for band, rounds in enumerate((1, 2, 4)):
            y = np.linalg.matrix_power(S, rounds) @ x
            power = np.linalg.matrix_power(S, 8) @ (inner * np.square(x - y).sum(axis=1, keepdims=True))
            np.testing.assert_allclose(found[k, :, band], np.sqrt(power[:, 0] + 1e-6), rtol=2e-4)
            x = y


def test_folds_elsewhere_cost_accuracy_but_no_depth():
    # The same ripples a quarter of a wave on: as deep, so the term is small; half as deep: it is not.
    template = small_template()
    angle = np.arctan2(template.T[:, 2], template.T[:, 0])
    outwards = np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)

    def rippled(height: float, phase: float) -> jax.Array:
        return jnp.asarray(template.T + height * np.sin(6 * angle + phase)[:, None] * outwards, jnp.float32)

    config = dataclasses.replace(CONFIG, lambda_folds=1.0)
    truth = rippled(0.01, 0.0)
    moved = detail_terms(rippled(0.01, np.pi / 2), truth, template=template, config=config)
    flatter = detail_terms(rippled(0.005, 0.0), truth, template=template, config=config)
    assert moved["vertex"] > 2 * flatter["vertex"]
    assert moved["folds"] < 0.25 * flatter["folds"]


def test_fold_depth_has_a_gradient_where_there_are_no_folds():
    template = small_template()
    flat = jnp.zeros((len(template.T), 3))
    assert np.isfinite(jax.grad(lambda V: fold_depth(V, template=template).sum())(flat)).all()


def test_without_its_weight_the_folds_are_no_term():
    template = small_template()
    T = jnp.asarray(template.T)
    assert set(detail_terms(T, T, template=template, config=CONFIG)) == {"vertex", "laplacian"}


def test_least_squares_by_hand():
    # Two scales: four patches of 0.5 and one of -1.
    real = [jnp.full((1, 2, 2), 0.5), jnp.full((1, 1, 1), -1.0)]
    fake = [jnp.zeros((1, 2, 2)), jnp.full((1, 1, 1), 1.0)]
    # to +1: (0.5 - 1)^2 = 0.25 and (-1 - 1)^2 = 4, mean over scales 2.125, not over the five patches
    assert score_error(real, 1.0) == pytest.approx(2.125)
    # fake to -1: (0 + 1)^2 = 1 and (1 + 1)^2 = 4, mean 2.5
    assert discriminator_loss(real, fake) == pytest.approx(2.125 + 2.5)
    # the generator's: fake to +1: 1 and 0, mean 0.5, times the weight
    config = dataclasses.replace(CONFIG, lambda_adversarial=0.1)
    assert adversarial_term(fake, config=config) == pytest.approx(0.05)
