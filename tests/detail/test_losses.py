"""Losses worked by hand."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.detail.losses import (
    adversarial_term,
    detail_terms,
    discriminator_loss,
    l1_cm,
    score_error,
)
from tests.detail.small_detail import CONFIG, small_template


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
