"""A garment of 60 vertices with networks of a few channels: what the stages' tests train and take apart."""

from functools import lru_cache
from typing import NamedTuple

import jax
import numpy as np

from garment_jax.body.root_frame import to_root
from garment_jax.body.seeds import Seeds, make_seeds
from garment_jax.config import GenerativeConfig, MotionConfig
from garment_jax.dataset.motion_input import MotionInput, motion_input
from garment_jax.dataset.template import STD_FLOOR, Statistics, Template, make_template
from garment_jax.model.generative.network import init_generative
from garment_jax.structs import Scene
from tests.reference import skinning
from tests.reference.scene import make_motion, make_scene, make_vertices

FRAMES = 40
SIZE = 16  # texels
GENERATIVE = GenerativeConfig(
    channels=(4, 6),
    latent_dim=8,
    part_dim=6,
    rec_hidden=(12, 12),
    rec_rank=10,
)
MOTION = MotionConfig(gru=10, dense=12, channels=(4, 4), state_dim=6, window=10, lanes=2)


class SmallModel(NamedTuple):
    """A scene with its prepared frames and the tables of its networks."""

    scene: Scene
    seeds: Seeds
    input: MotionInput
    V: np.ndarray  # [t, n, 3] float32 metres, root frame
    T_tilde: np.ndarray  # [t, n, 3] float32 metres; inverse skinning with the template's weights
    template: Template
    params: dict  # of the generative model, fresh


def fast_key(seed: int) -> jax.Array:
    """Return a key whose draws compile in a quarter of the default generator's time."""
    return jax.random.key(seed, impl="unsafe_rbg")


@lru_cache(maxsize=1)
def small_model() -> SmallModel:
    """Return the model; the same one for every test of a process."""
    scene = make_scene(4, 15)  # its vertices lie on texels of the map
    motion = make_motion(scene, FRAMES)
    seeds = make_seeds(scene, 6)
    inputs = motion_input(motion, scene, seeds, ("LeftUpLeg", "RightUpLeg"))
    V = to_root(make_vertices(scene, motion).astype(np.float64), inputs.root, inputs.yaw).astype(np.float32)
    T = scene.garment.template - scene.body.joints[0]
    W = skinning.softmax_weights(T, seeds.points, 0.1)
    frames = zip(V, inputs.R_seed, inputs.t_seed, strict=True)
    T_tilde = np.stack([skinning.unskin(v, W, R, t) for v, R, t in frames]).astype(np.float32)
    M = inputs.x.M
    statistics = Statistics(
        V.mean(axis=(0, 1)),
        V.std(axis=(0, 1)),
        M.mean(axis=0),
        np.maximum(M.std(axis=0), STD_FLOOR),
        M.min(axis=0),
        M.max(axis=0),
    )
    template = make_template(scene.garment, scene.body, statistics, uv_size=SIZE)
    params = init_generative(fast_key(0), template, config=GENERATIVE)
    return SmallModel(scene, seeds, inputs, V, T_tilde, template, params)
