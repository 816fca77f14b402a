"""Local dynamics of the tiny scene (128 vertices), with parameters that move the cloth."""

import dataclasses
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.config import DynamicsConfig
from garment_jax.dynamics.network import DynamicsCarry, init_dynamics
from garment_jax.dynamics.pose import BodyFrame, body_frames
from garment_jax.dynamics.tables import DynamicsTables, make_dynamics_tables
from garment_jax.rollout.model import Model
from garment_jax.structs import Motion
from tests.reference.scene import make_motion
from tests.rollout.tiny_model import CONFIG, SCENE, drawn, template, tiny_model

DYNAMICS = DynamicsConfig(
    steps=8, rows=8, columns=16, patch=4, channels=(6, 8), points=12, window=5, lanes=2, lane_windows=3
)


@lru_cache(maxsize=1)
def tables() -> DynamicsTables:
    """Return the static tables."""
    return make_dynamics_tables(SCENE, config=DYNAMICS, body=CONFIG.body)


@lru_cache(maxsize=1)
def params() -> dict:
    """Return parameters drawn at random: the cloth swings by centimetres."""
    static = tables()  # made on the host, not while tracing
    shapes = jax.eval_shape(lambda: init_dynamics(jax.random.key(0), static, config=DYNAMICS))
    rng = np.random.default_rng(3)
    return jax.tree.map(lambda leaf: 0.5 * drawn(rng, leaf.shape), shapes)


def dynamic_model() -> Model:
    """Return the tiny model with local dynamics beside its codes."""
    model = tiny_model()
    config = dataclasses.replace(model.config, dynamics=DYNAMICS)
    return model._replace(config=config, params={**model.params, "dynamics": params()})


def frames(t: int) -> BodyFrame:
    """Return the body of the first `t` frames of the tiny motion."""
    return jax.tree.map(jnp.asarray, body_frames(make_motion(SCENE, t), SCENE.body))


def motion(t: int) -> Motion:
    """Return the tiny motion."""
    return make_motion(SCENE, t)


def hanging() -> DynamicsCarry:
    """Return the template at rest, as one lane."""
    T = jnp.asarray(template().T)[None]
    return DynamicsCarry(T, T)
