"""Networks of a wanted size on a resampled garment, with random parameters: a speed needs no training.

The garment is `models/skirt`'s or the embedded one, its UV square as a grid of `vertices` vertices. The
collision solver gets garments that a trained model predicted (or, without a clip, the template carried by the
body) for the same motion, carried over to the grid: random parameters would put nothing in the body's way.
"""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from resampled import grid_shape, resample

from garment_jax.body.seeds import make_seeds
from garment_jax.config import Config
from garment_jax.dataset.motion_input import motion_input
from garment_jax.dataset.start import make_skinned_template
from garment_jax.dataset.template import STD_FLOOR, Statistics, Template, make_template
from garment_jax.io.sequence import open_sequence
from garment_jax.model.compose import RolloutState, init_state
from garment_jax.model.detail.network import init_detail
from garment_jax.model.generative.network import init_generative
from garment_jax.model.motion.network import init_motion
from garment_jax.structs import FrameInput, Motion, Scene

GRIDS = {9352: (56, 167), 2800: (40, 70)}  # rows and columns of the sizes that the targets speak of
CPU_CHANNELS = (24, 48, 96, 128)
MAP_STD = 0.2  # metres, of a skirt's vertices about their mean


class Case(NamedTuple):
    """Everything that one measurement runs on."""

    scene: Scene
    motion: Motion
    config: Config
    template: Template
    params: dict
    x: FrameInput  # leaves [t, ...]
    start: RolloutState
    V: np.ndarray  # [t, n, 3] metres, root frame: what the collision solver gets


def sized_config(uv: int, *, rank: int = 0, channels: tuple[int, ...] = CPU_CHANNELS) -> Config:
    """Return the default configuration with `uv` texels a side and a D_rec of three 512 wide layers."""
    default = Config()
    return replace(
        default,
        uv=replace(default.uv, size=uv),
        generative=replace(default.generative, channels=channels, rec_hidden=(512, 512, 512), rec_rank=rank),
        motion=replace(default.motion, channels=channels),
    )


def dressed(clip: Path | None, frames: int | None) -> tuple[Scene, Motion]:
    """Return scene and motion of the sequence file `clip`, or the embedded skirt and walk without one.

    The first `frames` of it; `None`: all of the clip, 500 of the walk.
    """
    if clip is None:
        from garment_jax.procedural.motions import make_motion
        from garment_jax.procedural.scene import make_outfit

        scene, _ = make_outfit("skirt")
        return scene, make_motion("walk", scene.body, seconds=(frames or 500) / 30)
    with open_sequence(clip) as sequence:
        motion = sequence.motion
        return sequence.scene, Motion(motion.rotations[:frames], motion.root[:frames], motion.fps)


def make_case(
    scene: Scene, motion: Motion, *, vertices: int, config: Config, predicted: np.ndarray | None = None
) -> Case:
    """Return the measurement of a garment of about `vertices` vertices on `scene`'s body.

    `predicted` `[t, n_old, 3]` (metres, root frame) is what the solver gets, on the scene's own garment.
    """
    grid = resample(scene, *GRIDS.get(vertices, grid_shape(vertices)))
    seeds = make_seeds(grid.scene, config.body.seeds)
    inputs = motion_input(motion, grid.scene, seeds, config.body.motion_joints)
    M = inputs.x.M
    statistics = Statistics(
        np.zeros(3, np.float32),
        np.full(3, MAP_STD, np.float32),
        M.mean(axis=0),
        np.maximum(M.std(axis=0), STD_FLOOR),
        M.min(axis=0),
        M.max(axis=0),
    )
    template = make_template(grid.scene.garment, grid.scene.body, statistics, uv_size=config.uv.size)
    pose = make_skinned_template(template.T, seeds, config.body.tau)
    skinned = pose(inputs.R_seed[:1], inputs.t_seed[:1])[0]
    if predicted is None:
        V = np.stack([pose(R[None], t[None])[0] for R, t in zip(inputs.R_seed, inputs.t_seed, strict=True)])
    else:
        V = grid.carry(predicted)
    params = random_parameters(template, config)
    start = init_state(params, skinned, template=template, config=config)
    return Case(grid.scene, motion, config, template, params, inputs.x, start, V)


def random_parameters(template: Template, config: Config) -> dict:
    """Return fresh parameters of all three stages."""
    keys = jax.random.split(jax.random.key(0), 3)
    return {
        "generative": init_generative(keys[0], template, config=config.generative),
        "motion": init_motion(keys[1], template, config=config.motion, generative=config.generative),
        "detail": init_detail(keys[2], template, config=config.detail, generative=config.generative),
    }


def predictions(model_folder: Path, clip: Path, frames: int) -> np.ndarray:
    """Return what the trained model predicts for the first `frames` of `clip`, without collision handling.

    `[t, n, 3]` metres, root frame.
    """
    from garment_jax.animation.clips import rollout_batch
    from garment_jax.model.scan import make_rollout
    from garment_jax.model.store import load_model, model_input, skinned_template, template_for

    model = load_model(model_folder)
    scene, motion = dressed(clip, frames)
    template, seeds = template_for(model, scene, str(clip))
    inputs = model_input(model, scene, template, seeds, motion)
    start = skinned_template(model, template, seeds, inputs)[None]
    state = init_state(model.params, start, template=template, config=model.config)
    run = make_rollout(template, model.config)
    return rollout_batch(run, model.params, state, [inputs.x], chunk=32)[0]


def repeated(state: RolloutState, copies: int) -> RolloutState:
    """Return the state of `copies` motions side by side."""
    return jax.tree.map(lambda leaf: jnp.repeat(leaf[None], copies, axis=0), state)
