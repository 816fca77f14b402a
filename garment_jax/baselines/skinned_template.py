"""The template carried rigidly by its seeds: no training, the start of every rollout."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.animation.frame_method import FrameMethod, in_chunks, step_of
from garment_jax.baselines.fitting import finish_model, open_baseline
from garment_jax.baselines.method import Method
from garment_jax.baselines.streaming import load_runner
from garment_jax.body.seeds import Seeds
from garment_jax.config import Config
from garment_jax.dataset.motion_input import motion_input
from garment_jax.dataset.template import Template
from garment_jax.geometry.skinning import skin, softmax_weights
from garment_jax.model.store import Model
from garment_jax.structs import Motion, Scene


class SeedFrame(NamedTuple):
    """The seeds' transforms of a frame, canonical -> posed, root frame."""

    R: Any  # [m, 3, 3]
    t: Any  # [m, 3] metres


def rollout(T: Float[Array, "n 3"], W: Float[Array, "n m"], x: SeedFrame) -> Float[Array, "t *b n 3"]:
    """Return the template `T` (metres, canonical root frame) carried by the seeds of `x` `[t, *b, ...]`."""
    carried = skin
    for _ in range(x.t.ndim - 2):
        carried = jax.vmap(carried, (None, None, 0, 0))
    return carried(T, W, x.R, x.t)


def fit(config: Config, run_dir: Path, data_dir: Path) -> None:
    """Write what describes the garment; there is nothing to learn."""
    with open_baseline("skinned_template", (), config, run_dir, data_dir) as run:
        finish_model(run, {})


def method_on(model: Model, scene: Scene, template: Template, seeds: Seeds) -> FrameMethod:
    """Return the method on a scene; it carries nothing from frame to frame."""
    T, points = jnp.asarray(template.T), jnp.asarray(seeds.points)
    W = jnp.asarray(np.asarray(softmax_weights(T, points, tau=model.config.body.tau)))

    def inputs(motion: Motion) -> Iterator[SeedFrame]:
        read = motion_input(motion, scene, seeds, model.config.body.motion_joints)
        return in_chunks(SeedFrame(read.R_seed, read.t_seed), model.config.rollout.chunk)

    def roll(params: dict, state: tuple, x: SeedFrame) -> tuple[tuple, jax.Array]:
        return state, rollout(T, W, x)

    return FrameMethod(model.params, lambda motion: (), inputs, step_of(roll), roll)


load = partial(load_runner, method_on)
METHOD = Method("skinned_template", "template skinned to the body", "rollout", fit, load)
