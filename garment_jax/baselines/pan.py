"""Pan et al. 2022, virtual bones: SSDR, a recurrent network for the bones, one for what they leave out.

80 bones with sparse convex weights (`bones.py`); a GRU on the standardised motion signature and a dense layer
to six numbers a bone; a second GRU on the bones' motions to ten features a vertex, beside two EdgeConv layers
on the smooth mesh, to a residual. The smooth part is trained first. What differs: the signature's root
translation does not exist in our root frame, so its tilt, velocity and yaw rate stand there; the joints are
those that our own network sees; the smooth part's loss is the mean squared vertex distance between the meshes
that predicted and fitted bones carry (a quadratic form of the bones' matrices, so training never touches the
mesh); the residual's is that of our own detail stage.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.animation.frame_method import FrameMethod, in_chunks, step_of
from garment_jax.baselines.bones import (
    Bones,
    bones_of,
    find_bones,
    transforms,
    weighted_rest,
)
from garment_jax.baselines.clip_errors import clip_errors
from garment_jax.baselines.features import columns, normalised, read_motion
from garment_jax.baselines.fitting import finish_model, open_baseline
from garment_jax.baselines.method import Method
from garment_jax.baselines.pan_network import Hidden, Rig, bone_motions, init_high, make_rig, rollout
from garment_jax.baselines.pan_residual import train_residual
from garment_jax.baselines.pan_targets import bone_targets
from garment_jax.baselines.recurrent import first_hidden, init_recurrent, train_recurrent
from garment_jax.baselines.streaming import load_runner
from garment_jax.body.seeds import Seeds
from garment_jax.config import Config
from garment_jax.dataset.template import Template
from garment_jax.model.store import Model
from garment_jax.structs import Motion, Scene
from garment_jax.training.run import Run

READS = "pose and root"


def bone_error(rig: Rig, y: np.ndarray) -> Any:
    """Return (standardised outputs, true bone motions `[*, b, 6]`) -> squared cm, mean over vertices.

    The squared distance of the two skinned meshes, |y dM|^2 with dM the difference of the bones' matrices,
    by the square root of y^T y / n.
    """
    values, vectors = np.linalg.eigh(y.T.astype(np.float64) @ y / len(y))
    root = jnp.asarray((vectors * np.sqrt(np.maximum(values, 0.0))).T.astype(np.float32))

    def error(out: jax.Array, target: jax.Array) -> jax.Array:
        dM = transforms(bone_motions(out, rig)) - transforms(target)
        flat = dM.reshape(*dM.shape[:-3], -1, 3)
        return 1e4 * jnp.square(jnp.einsum("jk,...kc->...jc", root, flat)).sum(axis=(-2, -1))

    return error


def fit(config: Config, run_dir: Path, data_dir: Path) -> None:
    """Train into `run_dir`: bones, smooth part, residual; goes on from the newest checkpoint."""
    with open_baseline("pan_2022", ("pan", "bones", "lanes", "inputs"), config, run_dir, data_dir) as run:
        bones = find_bones(run)
        targets = bone_targets(run, bones)
        every = np.concatenate([target for target in targets])
        mean, deviation = every.mean(axis=0), np.maximum(every.std(axis=0), 1e-4)
        rig = make_rig(run.template, bones, mean, deviation)
        chosen = columns(run.data.scene.body, run.config, READS)
        x = [normalised(clip.input.x.M, run.template, chosen) for clip in run.data.train]
        low = _train_low(run, rig, bones, x, targets, chosen)
        params = {"low": low}
        if run.config.baselines.pan_residual_steps:
            high = _first_high(run)
            validate = _validation(run, rig, chosen)
            check = None if validate is None else lambda high: validate({"low": low, "high": high})
            params["high"] = train_residual(run, rig, low, x, high, validate=check)
        finish_model(run, {**params, "weights": bones.weights, "mean": mean, "deviation": deviation})


def _train_low(
    run: Run,
    rig: Rig,
    bones: Bones,
    x: list[np.ndarray],
    targets: list[np.ndarray],
    chosen: np.ndarray,
) -> dict:
    settings, seed = run.config.baselines, run.config.training.seed
    network = init_recurrent(
        jax.random.key(seed + 50), inputs=len(chosen), width=settings.pan_gru, outputs=rig.mean.size
    )
    validate = _validation(run, rig, chosen)
    return train_recurrent(
        run,
        "bones",
        network,
        x,
        targets,
        bone_error(rig, weighted_rest(run.template.T, bones)),
        steps=settings.pan_steps,
        rate=settings.pan_rate,
        seed=51,
        validate=None if validate is None else lambda low: validate({"low": low}),
    )


def _first_high(run: Run) -> dict:
    settings = run.config.baselines
    key = jax.random.key(run.config.training.seed + 52)
    return init_high(key, run.template, bones=settings.bones, width=settings.pan_residual_gru)


def first_state(params: dict) -> Hidden:
    """Return the state before a motion's first frame."""
    high = first_hidden(params["high"]["network"]) if "high" in params else np.zeros(1, np.float32)
    return Hidden(first_hidden(params["low"]), high)


def _validation(run: Run, rig: Rig, chosen: np.ndarray) -> Any:
    """Return a function of the parameters: RMSE of the clips kept back, rolled out, cm; None without any."""
    clips = run.data.validation
    if not clips:
        return None
    inputs = [normalised(clip.input.x.M, run.template, chosen) for clip in clips]
    roll = jax.jit(partial(rollout, rig=rig, template=run.template))

    def validate(params: dict) -> dict[str, float]:
        V = [np.asarray(roll(params, first_state(params), x)[1]) for x in inputs]
        return clip_errors(clips, V)

    return validate


def method_on(model: Model, scene: Scene, template: Template, seeds: Seeds) -> FrameMethod:
    """Return the method on a scene."""
    chosen = columns(scene.body, model.config, READS)
    bones = bones_of(template.T, np.asarray(model.params["weights"]))
    rig = make_rig(template, bones, np.asarray(model.params["mean"]), np.asarray(model.params["deviation"]))
    roll = partial(rollout, rig=rig, template=template)

    def inputs(motion: Motion) -> Iterator[np.ndarray]:
        x = read_motion(motion, scene, model, template, chosen)
        return in_chunks(x, model.config.rollout.chunk)

    return FrameMethod(model.params, lambda motion: first_state(model.params), inputs, step_of(roll), roll)


load = partial(load_runner, method_on)
METHOD = Method("pan_2022", "Pan et al. 2022 (virtual bones)", "rollout", fit, load)
