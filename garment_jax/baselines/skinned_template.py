"""The template carried rigidly by its seeds: no training, the start of every rollout."""

from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.baselines.fitting import finish_model, fitted_model, open_baseline
from garment_jax.baselines.method import Method, Runner
from garment_jax.baselines.streaming import Beginning, Live, make_runner
from garment_jax.config import CollisionConfig, Config
from garment_jax.dataset.motion_input import motion_input
from garment_jax.geometry.skinning import skin, softmax_weights
from garment_jax.model.store import Model, template_for
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


def _live(model: Model, scene: Scene, name: str) -> Live:
    template, seeds = template_for(model, scene, name)
    points = jnp.asarray(template.T), jnp.asarray(seeds.points)
    W = np.asarray(softmax_weights(*points, tau=model.config.body.tau))

    def begin(motion: Motion) -> Beginning:
        inputs = motion_input(motion, scene, seeds, model.config.body.motion_joints)
        return Beginning(SeedFrame(inputs.R_seed, inputs.t_seed), (), inputs.root, inputs.yaw)

    return Live(begin, lambda params, state, x: (state, rollout(points[0], jnp.asarray(W), x)))


def load(run_dir: Path, collision: CollisionConfig | None = None, lengths: bool = False) -> Runner:
    """Return the runner of a fitted folder."""
    return make_runner(fitted_model(run_dir), _live, collision, lengths)


METHOD = Method("skinned_template", "template skinned to the body", "rollout", fit, load)
