"""The swing's stage: a ring of columns trained on its own rollouts (not in the paper)."""

from collections.abc import Callable
from functools import partial
from operator import itemgetter

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.data.lanes import LaneWindow, make_schedule
from garment_jax.data.prepared import DataSet, PreparedClip, frames_of
from garment_jax.rollout.swing import make_swing_rollout, roll_clip
from garment_jax.swing.motion import SwingFrame, swing_frames
from garment_jax.swing.network import at_rest, cells_of, init_swing
from garment_jax.swing.tables import SwingTables, make_swing_tables
from garment_jax.swing.train_step import SwingBatch, make_swing_train_step
from garment_jax.training.begin_from import begun_from, has_part, other_ring
from garment_jax.training.run import Run, optimise, say

CHUNK = 256  # frames of a clip whose cells are found, and that validation rolls out, at a time


class _Clip:
    """A clip as the ring learns it: its frames, and where its cells hang in each, `[t, a, h, 3]`."""

    def __init__(self, clip: PreparedClip, data: DataSet, tables: SwingTables, cells: Callable) -> None:
        self.frames = swing_frames(clip.motion, data.scene, tables)
        t = len(clip.V)
        pieces = []
        for start in range(0, t, CHUNK):
            which = np.minimum(np.arange(start, start + CHUNK), t - 1)  # one compiled length
            pieces.append(np.asarray(cells(frames_of(clip, which, data), self.frames.anchor[which])))
        self.X = np.concatenate(pieces)[:t]


def train_swing(run: Run) -> dict:
    """Return the trained parameters of the swing; goes on from the newest checkpoint."""
    config, seed, data = run.config.swing, run.config.training.seed, run.data
    tables = make_swing_tables(data.scene, config=config)
    cells = jax.jit(lambda V, anchor: cells_of(V, anchor, tables=tables))
    say("swing: finding the cells of the training clips")
    clips = [_Clip(clip, data, tables, cells) for clip in data.train]
    schedule = make_schedule(
        [len(clip.X) for clip in clips],
        lanes=config.lanes,
        window=config.window,
        steps=config.steps,
        seed=seed + 40,
        from_first=config.from_first,
        true_starts=1.0,
        lane_windows=config.lane_windows,
    )

    params = init_swing(jax.random.key(seed + 7), config=config)
    folder = run.config.training.begin_from
    if has_part(folder, "swing") and not other_ring(folder, run.config):
        params = begun_from(folder, "swing", params)
    return optimise(
        run,
        "swing",
        params,
        partial(make_swing_train_step, tables, config),
        lambda step: make_batch(clips, schedule[step], tables, config.window),
        steps=config.steps,
        learning_rate=config.learning_rate,
        weight_decay=config.weight_decay,
        seed=seed + 8,
        frames_per_step=config.lanes * config.window,
        carry=jax.tree.map(jnp.array, at_rest(tables, (config.lanes,), config=config)),
        validate=_validation(run, tables, cells),
    )


def make_batch(clips: list[_Clip], lanes: LaneWindow, tables: SwingTables, window: int) -> SwingBatch:
    """Return one window of every lane."""
    pairs = list(zip(lanes.clip, lanes.start, strict=True))
    cuts = [jax.tree.map(itemgetter(slice(s, s + window)), clips[c].frames) for c, s in pairs]
    frame = SwingFrame(*(np.stack(leaves, axis=1) for leaves in zip(*cuts, strict=True)))
    X_star = np.stack([clips[c].X[s : s + window] for c, s in pairs], axis=1)
    # a clip's first frame has none before it: there the template hangs, as in a rollout
    X_start = np.stack([clips[c].X[s - 1] if s else tables.rest for c, s in pairs])
    return SwingBatch(frame, X_star, lanes.fresh, X_start, lanes.fresh & (lanes.start > 0))


def _validation(run: Run, tables: SwingTables, cells: Callable) -> Callable[[dict], dict[str, float]] | None:
    """Return a function that rolls out the clips kept back from the template: RMSE of cells in cm."""
    if not run.data.validation:
        return None
    roll = make_swing_rollout(tables, run.config.swing)
    begun = at_rest(tables, (), config=run.config.swing)
    clips = [(clip.name, _Clip(clip, run.data, tables, cells)) for clip in run.data.validation]

    def validate(params: dict) -> dict[str, float]:
        errors = {}
        for name, clip in clips:
            X = roll_clip(roll, params, begun, clip.frames, chunk=CHUNK)
            square = (np.square(X - clip.X).sum(axis=-1) * tables.share).sum(axis=(-1, -2))
            errors[f"{name}_rmse_cm"] = float(100.0 * np.sqrt(square.mean()))
        return {"rmse_cm": float(np.mean(list(errors.values()))), **errors}

    return validate
