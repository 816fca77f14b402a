"""Pan's virtual bones: the loss without a mesh, the residual's start, and the chain of a rollout."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garment_jax.baselines.bones import bones_of, weighted_rest
from garment_jax.baselines.pan import bone_error, first_state
from garment_jax.baselines.pan_network import (
    VERTEX_FEATURES,
    init_high,
    low_mesh,
    make_rig,
    residual,
    rollout,
)
from garment_jax.baselines.recurrent import init_recurrent
from garment_jax.dataset.template import Template
from garment_jax.model.store import template_for
from tests.animation.tiny_model import SCENE, tiny_model

BONES = 5


@pytest.fixture(scope="module")
def template() -> Template:
    return template_for(tiny_model(), SCENE, "x")[0]


@pytest.fixture(scope="module")
def rig(template: Template):
    rng = np.random.default_rng(2)
    weights = rng.dirichlet(np.ones(BONES), len(template.T)).astype(np.float32)
    bones = bones_of(template.T, weights)
    mean, deviation = 0.2 * rng.normal(size=(BONES, 6)), rng.uniform(0.1, 0.3, (BONES, 6))
    made = make_rig(template, bones, mean.astype(np.float32), deviation.astype(np.float32))
    return bones, made


def test_the_bones_error_is_the_squared_distance_of_the_meshes(template: Template, rig) -> None:
    bones, made = rig
    rng = np.random.default_rng(4)
    out = rng.normal(size=(3, 2, 6 * BONES)).astype(np.float32)
    true = rng.normal(size=(3, 2, BONES, 6)).astype(np.float32)
    standard = ((true - np.asarray(made.mean)) / np.asarray(made.deviation)).reshape(3, 2, -1)
    error = jax.jit(bone_error(made, weighted_rest(template.T, bones)))(out, true)
    mesh = jax.jit(lambda x: low_mesh(x, made))
    distance = 100 * np.linalg.norm(np.asarray(mesh(out)) - np.asarray(mesh(jnp.asarray(standard))), axis=-1)
    np.testing.assert_allclose(error, np.square(distance).mean(axis=-1), rtol=1e-3)


def test_the_smooth_mesh_is_bones_about_their_centres(template: Template, rig) -> None:
    bones, made = rig
    numbers = np.asarray(made.mean)
    expected = np.zeros(template.T.shape)
    for b, (c, six) in enumerate(zip(bones.centres, numbers, strict=True)):
        R = Rotation.from_rotvec(six[:3]).as_matrix()
        expected += bones.weights[:, b : b + 1] * ((template.T - c) @ R.T + c + six[3:])
    np.testing.assert_allclose(low_mesh(jnp.zeros(6 * BONES), made), expected, atol=1e-5)


def test_features_belong_to_their_own_vertices(template: Template, rig) -> None:
    del rig
    params = init_high(jax.random.key(0), template, bones=BONES, width=4)
    V, n = jnp.asarray(template.T), len(template.T)
    none = jnp.zeros(VERTEX_FEATURES * n)
    # feature 3 of vertex 9
    one = none.at[3 * n + 9].set(1.0)
    f = jax.jit(lambda x: residual(params, V, x, template=template))
    change = np.asarray(f(one) - f(none))
    assert np.flatnonzero(np.abs(change).max(axis=-1) > 0).tolist() == [9]
    kernel = np.asarray(params["out"]["kernel"])[16 + 3]
    np.testing.assert_allclose(change[9], 0.01 * kernel, atol=1e-6)


def test_a_rollout_adds_the_residual_to_the_smooth_mesh(template: Template, rig) -> None:
    low = init_recurrent(jax.random.key(1), inputs=4, width=5, outputs=6 * BONES)
    high = init_high(jax.random.key(2), template, bones=BONES, width=4)
    x = np.random.default_rng(1).normal(size=(3, 2, 4)).astype(np.float32)

    def rolled(params: dict) -> np.ndarray:
        state = jax.tree.map(lambda h: jnp.stack([h, h]), first_state(params))
        return np.asarray(
            jax.jit(lambda p, s: rollout(p, s, jnp.asarray(x), rig=rig[1], template=template))(params, state)[
                1
            ]
        )

    smooth, whole = rolled({"low": low}), rolled({"low": low, "high": high})
    assert smooth.shape == whole.shape == (3, 2, len(template.T), 3)
    off = 100 * np.linalg.norm(whole - smooth, axis=-1)
    assert 1e-4 < off.max() < 2  # cm: it begins near zero
