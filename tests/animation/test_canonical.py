"""A model in canonical pose: the scan is the loop, and what comes out is posed by the joints."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.animation.animate import animate
from garment_jax.body.root_frame import heading, to_root, yaw_matrix
from garment_jax.model.compose import init_state, step
from garment_jax.model.scan import latent_rollout, make_rollout
from garment_jax.model.store import load_model, save_model, skinned_template
from garment_jax.structs import Motion
from tests.animation.tiny_model import SCENE, canonical_model, inputs_of, seeds, template, tiny_model
from tests.reference import skinning
from tests.reference.scene import make_motion

MODEL = canonical_model()
TABLES = template(MODEL)
FRAMES = 40


@pytest.fixture(scope="module")
def inputs():
    return inputs_of(make_motion(SCENE, FRAMES, seed=3, legs=1.9))


@pytest.fixture(scope="module")
def start(inputs):
    V = skinned_template(MODEL, TABLES, seeds(), inputs)
    np.testing.assert_array_equal(V, TABLES.T)  # a template that the joints carry is unposed the template
    return init_state(MODEL.params, V, template=TABLES, config=MODEL.config)


def test_scan_equals_a_python_loop_of_step(inputs, start):
    V = make_rollout(TABLES, MODEL.config)(MODEL.params, start, inputs.x)[1]
    one, state = jax.jit(partial(step, template=TABLES, config=MODEL.config)), start
    for t in range(FRAMES):
        state, v = one(MODEL.params, state, inputs.frame(t))
        np.testing.assert_allclose(v, V[t], atol=1e-5)


def test_the_decoded_garment_is_posed_by_naive_skinning(inputs, start):
    params = {k: MODEL.params[k] for k in ("generative", "motion")}
    roll = jax.jit(lambda p, s, x: latent_rollout(p, s, x, template=TABLES, config=MODEL.config))
    U = np.asarray(roll(params, start.motion, inputs.x)[2], np.float64)
    V = make_rollout(TABLES, MODEL.config, detail=False)(params, start, inputs.x)[1]
    x, W = inputs.x, np.asarray(TABLES.W)
    for t in (0, 17, FRAMES - 1):
        np.testing.assert_allclose(V[t], skinning.skin(U[t], W, x.R[t], x.t[t]), atol=1e-5)


def test_a_jump_of_the_root_leaves_the_last_frame_as_it_was(inputs, start):
    one = jax.jit(partial(step, template=TABLES, config=MODEL.config))
    x = inputs.frame(0)
    jumped = x._replace(turn=np.diag([-1.0, 1, -1]).astype(np.float32), shift=x.shift + 5.0)
    np.testing.assert_array_equal(one(MODEL.params, start, x)[1], one(MODEL.params, start, jumped)[1])


def test_a_clip_moved_and_turned_is_the_same_clip_and_not_the_root_frames(tmp_path):
    saved = load_model(save_model(MODEL, tmp_path / "model", bits=32))
    here = make_motion(SCENE, 30, seed=2, legs=1.9)
    turn = yaw_matrix(np.array(np.radians(137.0)))
    there = Motion(turn @ here.rotations, here.root @ turn.T + [60.0, 0.0, -80.0], here.fps)

    def shapes(model, motion):
        chunks = animate(model, SCENE, motion, collision=False)
        V = np.concatenate([chunk.V for chunk in chunks]).astype(np.float64)
        return to_root(V, motion.root.astype(np.float64), heading(motion.rotations[:, 0]))

    V = shapes(MODEL, here)
    assert np.linalg.norm(shapes(saved, there) - V, axis=-1).max() < 1e-4
    assert np.abs(shapes(tiny_model(), here) - V).max() > 0.01


def test_motions_side_by_side_are_one_by_one(inputs, start):
    other = inputs_of(make_motion(SCENE, FRAMES, seed=5, legs=1.9))
    run = make_rollout(TABLES, MODEL.config)
    both = jax.tree.map(lambda *leaves: np.stack(leaves, axis=1), inputs.x, other.x)
    state = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), start)
    V = run(MODEL.params, state, both)[1]
    for b, x in enumerate((inputs.x, other.x)):
        np.testing.assert_allclose(V[:, b], run(MODEL.params, start, x)[1], atol=1e-5)
