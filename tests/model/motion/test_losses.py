import dataclasses
from functools import partial

import jax
import numpy as np
import pytest

from garment_jax.model.motion.losses import motion_terms
from tests.reference.laplacian import uniform_laplacian
from tests.reference.small_model import MOTION, small_model


@pytest.mark.parametrize("norm", ["cm2", "plain"])
def test_every_term_by_hand(norm):
    model = small_model()
    rng = np.random.default_rng(0)
    V_star = model.V[0]
    V = V_star + rng.normal(0, 0.02, V_star.shape).astype(np.float32)
    Z, Z_star = rng.normal(size=(2, 8)).astype(np.float32)
    config = dataclasses.replace(MOTION, norm=norm)
    terms = jax.jit(partial(motion_terms, template=model.template, config=config))(V, V_star, Z, Z_star)

    def size(E: np.ndarray) -> float:
        square = 1e4 * (E.astype(float) ** 2).sum()
        return square / len(E) if norm == "cm2" else np.sqrt(square)

    rough = uniform_laplacian((V - V_star).astype(float), model.scene.garment.faces)
    assert terms.keys() == {"vertex", "laplacian", "latent"}
    assert terms["vertex"] == pytest.approx(size(V - V_star), rel=1e-4)
    assert terms["laplacian"] == pytest.approx(1.5 * size(rough), rel=1e-4)
    assert terms["latent"] == pytest.approx(0.5 * ((Z - Z_star) ** 2).mean(), rel=1e-4)
