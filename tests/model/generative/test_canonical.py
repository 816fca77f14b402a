"""The networks' frame: posing and unposing against vertex-by-vertex loops."""

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.body.garment_skinning import garment_weights, joint_transforms
from garment_jax.model.generative.canonical import posed, unposed
from garment_jax.structs import FrameInput
from tests.animation.tiny_model import SCENE, template
from tests.reference import skinning
from tests.reference.scene import make_motion

W = garment_weights(SCENE, reach=0.1, mirrored=True)
CANONICAL = template()._replace(W=W)
R, T = joint_transforms(make_motion(SCENE, 6, legs=1.9), SCENE)
X = FrameInput(None, None, None, R, T)
U = template().T + np.random.default_rng(1).normal(size=(6, *template().T.shape)).astype(np.float32) / 50


def test_posed_is_the_naive_skinning_by_joints_any_axes_in_front():
    expected = np.stack([skinning.skin(u, W, r, t) for u, r, t in zip(U, R, T, strict=True)])
    run = jax.jit(lambda U, x: posed(U, x, template=CANONICAL))
    np.testing.assert_allclose(run(U, X), expected, atol=1e-5)
    np.testing.assert_allclose(run(U[2], jax.tree.map(lambda leaf: leaf[2], X)), expected[2], atol=1e-5)
    pairs = jax.tree.map(lambda leaf: leaf.reshape(3, 2, *leaf.shape[1:]), (U, X))
    np.testing.assert_allclose(run(*pairs).reshape(expected.shape), expected, atol=1e-5)


def test_unposed_undoes_it():
    run = jax.jit(lambda V, x: unposed(V, x, template=CANONICAL))
    V = jax.jit(lambda U, x: posed(U, x, template=CANONICAL))(U, X)
    np.testing.assert_allclose(run(V, X), U, atol=1e-4)
    np.testing.assert_allclose(run(V[1], jax.tree.map(lambda leaf: leaf[1], X)), U[1], atol=1e-4)


def test_in_the_root_frame_nothing_is_done():
    V = jnp.asarray(U)
    assert posed(V, X, template=template()) is V
    assert unposed(V, X, template=template()) is V


def test_joints_turned_against_each_other_stay_finite():
    opposite = R[:1].copy()
    for name in ("LeftUpLeg", "LeftLeg", "LeftFoot"):
        opposite[0, SCENE.body.joint_names.index(name)] = np.diag([-1.0, -1.0, 1.0])
    x = FrameInput(None, None, None, jnp.asarray(opposite), jnp.asarray(T[:1]))
    V = unposed(jnp.asarray(U[:1]), x, template=CANONICAL)
    assert np.isfinite(V).all()
