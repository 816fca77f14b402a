"""The local dynamics' stage: a learned simulator trained on its own rollouts (not in the paper)."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.data.batches import lane_schedule, lane_starts, lane_vertices, lane_weights
from garment_jax.data.lanes import LaneWindow
from garment_jax.data.prepared import DataSet, frames_of
from garment_jax.dynamics.network import DynamicsCarry, init_dynamics
from garment_jax.dynamics.pose import BodyFrame, body_frames
from garment_jax.dynamics.tables import make_dynamics_tables
from garment_jax.dynamics.train_step import DynamicsBatch, make_dynamics_train_step
from garment_jax.rollout.dynamics import make_dynamics_rollout, roll_clip
from garment_jax.structs import TrainState
from garment_jax.training.begin_from import begun_from
from garment_jax.training.optimiser import make_optimiser
from garment_jax.training.run import Run, optimise

CHUNK = 100  # frames of a validation rollout at a time


def train_dynamics(run: Run) -> dict:
    """Return the trained parameters of the local dynamics; goes on from the newest checkpoint."""
    config, seed, n = run.config.dynamics, run.config.training.seed, len(run.template.T)
    tables = make_dynamics_tables(run.data.scene, config=config, body=run.config.body)
    bodies = [body_frames(clip.motion, run.data.scene.body) for clip in run.data.train]
    lanes_at = lane_schedule(
        run.data, config, lanes=config.lanes, steps=config.steps, seed=seed + 40, growth=config.growth
    )

    def batch_at(step: int) -> DynamicsBatch:
        return make_batch(run, bodies, lanes_at[step])

    def begin(optimiser) -> TrainState:
        params = init_dynamics(jax.random.key(seed + 7), tables, config=config)
        if config.begin_from:
            params = begun_from(config.begin_from, "dynamics", params, key="dynamics.begin_from")
        empty = jnp.zeros((config.lanes, n, 3))
        carry = DynamicsCarry(empty, empty + 0.0)
        return TrainState(params, optimiser.init(params), jax.random.key(seed + 8), jnp.int32(0), carry)

    state = optimise(
        run,
        "dynamics",
        begin,
        lambda optimiser: make_dynamics_train_step(tables, config, optimiser),
        batch_at,
        optimiser=make_optimiser(
            run.config.training,
            learning_rate=config.learning_rate,
            weight_decay=config.weight_decay,
            steps=config.steps,
        ),
        steps=config.steps,
        validate=_validation(run, tables),
        frames_per_step=config.lanes * config.window,
    )
    return state.params


def make_batch(run: Run, bodies: list[BodyFrame], lanes: LaneWindow) -> DynamicsBatch:
    """Return one window of every lane."""
    config, data, n = run.config.dynamics, run.data, len(run.template.T)
    windows = [_cut(bodies[c], s, config.window) for c, s in zip(lanes.clip, lanes.start, strict=True)]
    frame = BodyFrame(*(np.stack(leaves, axis=1) for leaves in zip(*windows, strict=True)))
    V_start = lane_starts(data, lanes, run.skinned, n)
    V_before = V_start.copy()
    for lane in np.flatnonzero(lanes.fresh & lanes.true_start):
        V_before[lane] = _before(data, bodies, int(lanes.clip[lane]), int(lanes.start[lane]))
    return DynamicsBatch(
        frame,
        lane_vertices(data, lanes, config.window),
        lane_weights(lanes, config),
        lanes.fresh,
        V_start,
        V_before,
        lanes.true_start,
    )


def _cut(body: BodyFrame, start: int, window: int) -> BodyFrame:
    return BodyFrame(*(leaf[start : start + window] for leaf in body))


def _before(data: DataSet, bodies: list[BodyFrame], clip: int, start: int) -> np.ndarray:
    """Return the true frame `start - 2` in the root frame of `start - 1` (at a clip's begin, its first)."""
    last, before = max(start - 1, 0), max(start - 2, 0)
    V = frames_of(data.train[clip], np.array([before]), data)[0]
    return V if last == before else V @ bodies[clip].turn[last] + bodies[clip].shift[last]


def _validation(run: Run, tables) -> Callable[[TrainState], dict[str, float]] | None:
    """Return a function that rolls out the clips kept back from the skinned template: RMSE in cm."""
    clips = run.data.validation
    if not clips:
        return None
    roll = make_dynamics_rollout(tables, run.template, run.config)
    bodies = [body_frames(clip.motion, run.data.scene.body) for clip in clips]
    starts = [np.asarray(run.skinned(clip.input.R_seed[:1], clip.input.t_seed[:1]))[0] for clip in clips]

    def validate(state: TrainState) -> dict[str, float]:
        errors = {}
        for clip, body, start in zip(clips, bodies, starts, strict=True):
            pieces = roll_clip(roll, state.params, start, body, clip.input.x.M, chunk=CHUNK)
            V = np.concatenate([V for _, V in pieces])[: len(clip.V)]
            square = 1e4 * np.square(V - clip.V).sum(axis=-1).mean()
            errors[f"{clip.name}_rmse_cm"] = float(np.sqrt(square))
        return {"rmse_cm": float(np.mean(list(errors.values()))), **errors}

    return validate
