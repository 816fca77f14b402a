"""An untrained model of 128 vertices whose rollouts move: what the rollout's tests run on."""

from dataclasses import replace
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.body.seeds import Seeds, make_seeds
from garment_jax.config import (
    BodyConfig,
    Config,
    DataConfig,
    DetailConfig,
    GenerativeConfig,
    MotionConfig,
    RolloutConfig,
    TrainingConfig,
    UvConfig,
)
from garment_jax.dataset.motion_input import MotionInput, motion_input
from garment_jax.dataset.start import make_skinned_template
from garment_jax.dataset.template import STD_FLOOR, Statistics, Template
from garment_jax.io.content_hash import garment_hash
from garment_jax.model.compose import RolloutState, init_state
from garment_jax.model.detail.network import init_detail
from garment_jax.model.generative.network import init_generative
from garment_jax.model.motion.network import init_motion
from garment_jax.model.store import Model, template_for
from garment_jax.structs import Motion
from tests.reference.scene import make_motion, make_scene

CONFIG = Config(
    data=DataConfig(validation=("waltz_3",)),
    body=BodyConfig(seeds=12),
    uv=UvConfig(size=16),
    generative=GenerativeConfig(
        channels=(4, 4, 6, 8),
        latent_dim=8,
        part_dim=4,
        rec_hidden=(8,),
        rec_rank=6,
        steps=8,
        batch=6,
        learning_rate=1e-3,
    ),
    motion=MotionConfig(
        gru=16,
        dense=8,
        channels=(4, 4, 6, 8),
        state_dim=8,
        state_hidden=8,
        window=5,
        lanes=2,
        lane_windows=3,
        warm_up_steps=8,
        warm_up_lanes=4,
        steps=8,
        learning_rate=1e-3,
    ),
    detail=DetailConfig(
        features=(4, 5), code_features=(8, 4), hidden=8, vertex_code=2, channels=(4, 6, 8), steps=8, batch=2
    ),
    training=TrainingConfig(log_every=1, checkpoint_seconds=0.0, validate_every=0),
    rollout=RolloutConfig(chunk=16),
)
SCENE = make_scene()
JOINTS = CONFIG.body.motion_joints


def seeds() -> Seeds:
    return make_seeds(SCENE, CONFIG.body.seeds)


def inputs_of(motion: Motion) -> MotionInput:
    """Return the networks' inputs of a motion of the tiny scene."""
    return motion_input(motion, SCENE, seeds(), JOINTS)


@lru_cache(maxsize=1)
def tiny_model() -> Model:
    """Return the model, the same for every test of a process.

    Every parameter is drawn here: beginning from the networks' own starts, which are near zero, garments
    would hang still, and compiling those starts takes longer than all these tests.
    """
    M = inputs_of(make_motion(SCENE, 60)).x.M
    statistics = Statistics(
        np.array([0.0, -0.1, 0.0], np.float32),
        np.full(3, 0.2, np.float32),
        M.mean(axis=0),
        np.maximum(M.std(axis=0), STD_FLOOR),
        M.min(axis=0),
        M.max(axis=0),
    )
    model = Model(CONFIG, {}, statistics, garment_hash(SCENE.garment), len(SCENE.garment.template), 30.0)
    tables, _ = template_for(model, SCENE, "the tiny clip")
    c, key = CONFIG, jax.random.key(0)
    shapes = {
        "generative": jax.eval_shape(lambda: init_generative(key, tables, config=c.generative)),
        "motion": jax.eval_shape(lambda: init_motion(key, tables, config=c.motion, generative=c.generative)),
        "detail": jax.eval_shape(lambda: init_detail(key, tables, config=c.detail, generative=c.generative)),
    }
    rng = np.random.default_rng(7)
    params = jax.tree.map(lambda leaf: drawn(rng, leaf.shape), shapes)
    return model._replace(params=params)


def canonical_model() -> Model:
    """Return the tiny model with its networks in canonical pose; the parameters are the same."""
    generative = replace(CONFIG.generative, skin_reach=0.1)
    return tiny_model()._replace(config=replace(CONFIG, generative=generative))


def drawn(rng: np.random.Generator, shape: tuple[int, ...]) -> jax.Array:
    """Return a kernel larger than usual, or a bias: garments swing by decimetres and state matters."""
    fan_in = int(np.prod(shape[:-1])) if len(shape) > 1 else 25
    drawn = rng.normal(size=shape) * 1.5 / np.sqrt(fan_in)
    return jax.device_put(drawn.astype(np.float32))  # `jnp.asarray` compiles a program for every shape


def template(model: Model | None = None) -> Template:
    """Return the static tables of the tiny model, or of another one of its garment."""
    return template_for(model or tiny_model(), SCENE, "the tiny clip")[0]


def first_state(*inputs: MotionInput) -> RolloutState:
    """Return the state before the first frames of motions side by side, from the skinned template."""
    pose = make_skinned_template(template().T, seeds(), CONFIG.body.tau)
    V = pose(np.stack([i.R_seed[0] for i in inputs]), np.stack([i.t_seed[0] for i in inputs]))
    return init_state(tiny_model().params, V, template=template(), config=CONFIG)


def alone(state: RolloutState, motion: int = 0) -> RolloutState:
    """Return one motion's state out of those side by side."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf[motion]), state)
