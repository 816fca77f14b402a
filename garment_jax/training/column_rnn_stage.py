"""The column RNN's stage: a ring of columns trained on its own rollouts (not in the paper)."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.dataset.lanes import make_schedule
from garment_jax.dataset.template import ColumnTables
from garment_jax.model.column_rnn.network import at_rest, init_column_rnn
from garment_jax.model.column_rnn.rollout import make_column_rollout, roll_clip
from garment_jax.model.column_rnn.tables import make_column_tables
from garment_jax.model.column_rnn.train_step import ColumnBatch, make_column_train_step
from garment_jax.training.column_clips import CHUNK, batches, column_clips
from garment_jax.training.pretrained import has_part, load_pretrained, other_ring
from garment_jax.training.run import Run, optimise, say


def train_column_rnn(run: Run) -> dict:
    """Return the trained parameters of the column RNN; goes on from the newest checkpoint."""
    config, seed = run.config.column_rnn, run.config.training.seed
    tables = make_column_tables(run.data.scene, config=config)
    say("column_rnn: finding the cells of the training clips")
    clips = column_clips(run.data.train, run.data, tables, workers=run.config.simulation.workers)
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
    params = init_column_rnn(jax.random.key(seed + 7), config=config)
    folder = run.config.training.begin_from
    if has_part(folder, "column_rnn") and not other_ring(folder, run.config):
        params = load_pretrained(folder, "column_rnn", params)
    return optimise(
        run,
        "column_rnn",
        params,
        partial(make_column_train_step, tables, config),
        batches(clips, schedule, tables.rest, config.window, rows=run.devices.rows(config.lanes)),
        steps=config.steps,
        learning_rate=config.learning_rate,
        weight_decay=config.weight_decay,
        seed=seed + 8,
        frames_per_step=config.lanes * config.window,
        carry=jax.tree.map(jnp.array, at_rest(tables, (config.lanes,), config=config)),
        validate=_validation(run, tables),
        axes=ColumnBatch(1, 1, 0, 0, 0),  # pyright: ignore[reportArgumentType]
    )


def _validation(run: Run, tables: ColumnTables) -> Callable[[dict], dict[str, float]] | None:
    """Return a function that rolls out the clips kept back from the template: RMSE of cells in cm."""
    if not run.data.validation:
        return None
    roll = make_column_rollout(tables, run.config.column_rnn)
    begun = at_rest(tables, (), config=run.config.column_rnn)
    names = [clip.name for clip in run.data.validation]
    clips = list(zip(names, column_clips(run.data.validation, run.data, tables), strict=True))

    def validate(params: dict) -> dict[str, float]:
        errors = {}
        for name, clip in clips:
            X = roll_clip(roll, params, begun, clip.frames, chunk=CHUNK)
            square = (np.square(X - clip.X).sum(axis=-1) * tables.share).sum(axis=(-1, -2))
            errors[f"{name}_rmse_cm"] = float(100.0 * np.sqrt(square.mean()))
        return {"rmse_cm": float(np.mean(list(errors.values()))), **errors}

    return validate
