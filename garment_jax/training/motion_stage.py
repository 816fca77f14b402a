"""Stage 2: the dynamic motion encoder (paper 3.3), after a warm-up in the linearised latent space."""

from collections.abc import Callable
from functools import partial

import jax
import numpy as np

from garment_jax.animation.clips import rollout_batch
from garment_jax.dataset.batches import (
    lane_inputs,
    lane_latents,
    lane_schedule,
    lane_starts,
    lane_vertices,
    lane_weights,
)
from garment_jax.dataset.prepared import targets_of
from garment_jax.model.compose import init_state
from garment_jax.model.motion.network import init_motion
from garment_jax.model.motion.train_step import MotionBatch, empty_carry, make_motion_train_step
from garment_jax.model.motion.warm_up import (
    LinearGarment,
    WarmUpBatch,
    empty_warm_up_carry,
    fit_linear_garment,
    make_warm_up_step,
    pooled_map,
)
from garment_jax.model.scan import make_rollout
from garment_jax.training.latents import true_latents
from garment_jax.training.pretrained import load_pretrained
from garment_jax.training.run import Run, optimise

LINEAR_FRAMES = 1_200  # frames that the linearised garment is fitted to


def train_motion(run: Run, generative: dict) -> dict:
    """Return the trained parameters of the motion encoder; goes on from the newest checkpoint."""
    config = run.config.motion
    Z = true_latents(run, generative)
    params = init_motion(
        jax.random.key(run.config.training.seed + 2),
        run.template,
        config=config,
        generative=run.config.generative,
    )
    params = load_pretrained(run.config.training.begin_from, "motion", params)
    if config.warm_up_steps and run.config.generative.linear_skip:
        params = _warm_up(run, params, generative, Z)
    if not config.steps:
        return params
    return _full_loop(run, params, generative, Z)


def linear_garment(run: Run, Z: list[np.ndarray]) -> LinearGarment:
    """Return the linear garment that fits frames spread over the training clips."""
    stride = max(sum(map(len, Z)) // LINEAR_FRAMES, 1)
    picks = [np.arange(i % stride, len(z), stride) for i, z in enumerate(Z)]
    V = [targets_of(clip, w, run.data) for clip, w in zip(run.data.train, picks, strict=True)]
    latents = np.concatenate([z[w] for z, w in zip(Z, picks, strict=True)])
    return fit_linear_garment(
        latents,
        np.concatenate(V),
        template=run.template,
        lambda_laplacian=run.config.motion.lambda_laplacian,
    )


def _warm_up(run: Run, params: dict, generative: dict, Z: list[np.ndarray]) -> dict:
    config, seed = run.config.motion, run.config.training.seed
    linear, n = linear_garment(run, Z), len(run.template.T)
    rows = run.devices.rows(config.warm_up_lanes)
    lanes_at = lane_schedule(
        run.data, config, lanes=config.warm_up_lanes, steps=config.warm_up_steps, seed=seed + 10
    )
    pooled = jax.jit(lambda V: pooled_map(V, run.template))

    def batch_at(step: int) -> WarmUpBatch:
        lanes = lanes_at[step].part(rows)
        start = np.asarray(pooled(lane_starts(run.data, lanes, run.skinned, n)))
        return WarmUpBatch(
            lane_inputs(run.data, lanes, config.window),
            lane_latents(Z, lanes, config.window),
            lane_weights(lanes, config),
            lanes.fresh,
            start,
        )

    return optimise(
        run,
        "warm_up",
        params,
        partial(make_warm_up_step, linear, run.template, config),
        batch_at,
        steps=config.warm_up_steps,
        learning_rate=config.warm_up_rate,
        weight_decay=config.weight_decay,
        seed=seed + 3,
        frames_per_step=config.warm_up_lanes * config.window,
        carry=empty_warm_up_carry(config.warm_up_lanes, linear, config),
        validate=_validation(run, generative),
        axes=WarmUpBatch(1, 1, 1, 0, 0),  # pyright: ignore[reportArgumentType]
    )


def _full_loop(run: Run, params: dict, generative: dict, Z: list[np.ndarray]) -> dict:
    config, seed, n = run.config.motion, run.config.training.seed, len(run.template.T)
    lanes_at = lane_schedule(run.data, config, lanes=config.lanes, steps=config.steps, seed=seed + 20)
    rows = run.devices.rows(config.lanes)

    def batch_at(step: int) -> MotionBatch:
        lanes = lanes_at[step].part(rows)
        return MotionBatch(
            lane_inputs(run.data, lanes, config.window),
            lane_vertices(run.data, lanes, config.window),
            lane_latents(Z, lanes, config.window),
            lane_weights(lanes, config),
            lanes.fresh,
            lane_starts(run.data, lanes, run.skinned, n),
        )

    return optimise(
        run,
        "motion",
        params,
        partial(make_motion_train_step, run.template, generative, config, run.config.generative),
        batch_at,
        steps=config.steps,
        learning_rate=config.learning_rate,
        weight_decay=config.weight_decay,
        seed=seed + 4,
        frames_per_step=config.lanes * config.window,
        carry=empty_carry(config.lanes, n, config),
        validate=_validation(run, generative),
        axes=MotionBatch(1, 1, 1, 1, 0, 0),  # pyright: ignore[reportArgumentType]
    )


def _validation(run: Run, generative: dict) -> Callable[[dict], dict[str, float]] | None:
    """Return a function that rolls out the clips kept back from the skinned template: RMSE in cm."""
    clips = run.data.validation
    if not clips:
        return None
    roll = make_rollout(run.template, run.config, detail=False)
    first = [(clip.input.R_seed[0], clip.input.t_seed[0]) for clip in clips]
    start = run.skinned(np.stack([R for R, _ in first]), np.stack([t for _, t in first]))

    def validate(motion: dict) -> dict[str, float]:
        params = {"generative": generative, "motion": motion}
        V = rollout_batch(
            roll,
            params,
            init_state(params, start, template=run.template, config=run.config),
            [clip.input.x for clip in clips],
            chunk=100,
        )
        square = [1e4 * np.square(v - clip.V).sum(axis=-1).mean() for v, clip in zip(V, clips, strict=True)]
        errors = {f"{c.name}_rmse_cm": float(np.sqrt(s)) for c, s in zip(clips, square, strict=True)}
        return {"rmse_cm": float(np.mean(list(errors.values()))), **errors}

    return validate
