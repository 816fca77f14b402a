"""A training run: what its stages share, and the stages one after the other."""

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from garment_jax.config import Config, content_hash, to_dict
from garment_jax.dataset.prepared import DataSet, prepare, training_clips
from garment_jax.dataset.start import make_start
from garment_jax.dataset.template import Template, scene_template
from garment_jax.io.content_hash import garment_hash
from garment_jax.io.sequence import open_sequence
from garment_jax.model.scene_file import SCENE, sample_of, write_sample
from garment_jax.storage.scratch import sweep
from garment_jax.structs import TrainState
from garment_jax.training.average import with_average
from garment_jax.training.checkpoint import Checkpointer
from garment_jax.training.devices import ONE, Devices
from garment_jax.training.log import RunLog
from garment_jax.training.loop import StepFn, run_stage
from garment_jax.training.optimiser import make_optimiser
from garment_jax.training.pretrained import find_beginning
from garment_jax.training.run_directory import (
    CACHE,
    CHECKPOINTS,
    FACTS_NAME,
    check_run,
    prepare_run,
    run_facts,
)
from garment_jax.training.simulated_clips import (
    check_motions,
    check_simulation,
    clips_folder,
    make_simulated_clips,
)


class Run(NamedTuple):
    """An open run directory with everything that its stages read."""

    config: Config
    folder: Path
    data: DataSet
    template: Template
    skinned: Callable[..., jax.Array]  # (R_seed, t_seed) -> skinned template, networks' frame
    log: RunLog
    devices: Devices = ONE


def open_run(
    config: Config,
    folder: str | Path,
    *,
    data_dir: str | Path,
    tensorboard: bool = False,
    more_facts: Mapping[str, Any] | None = None,
    check: Callable[[DataSet], None] | None = None,
    unposed: bool = True,
    devices: Devices = ONE,
) -> Run:
    """Prepare the data (simulated first where that is asked for; cached in the run's folder); open the run.

    `more_facts` are values of JSON that must stay as well, beside configuration, garment and data set.
    `check` refuses data, the recorded clips alone, before the folder belongs to a configuration that does not
    fit them; `unposed` as in `prepare`. Of several processes the first prepares and writes, the others read.
    Raises `ValueError` for a folder that belongs to others, for processes that read other clips than the
    first, and as `find_beginning`.
    """
    opened = devices.after_first(
        lambda: _opened(config, Path(folder), data_dir, tensorboard, more_facts, check, unposed, devices)
    )
    devices.check_same(f"the content of {data_dir}", opened.data.content)
    return opened


def _opened(
    config: Config,
    folder: Path,
    data_dir: str | Path,
    tensorboard: bool,
    more_facts: Mapping[str, Any] | None,
    check: Callable[[DataSet], None] | None,
    unposed: bool,
    devices: Devices,
) -> Run:
    simulating = config.simulation.clips > 0
    if simulating:
        check_simulation(config.simulation)
    with open_sequence(training_clips(data_dir, config.data.validation)[0]) as first:
        facts = {"garment": garment_hash(first.scene.garment), **(more_facts or {})}
        beginning = find_beginning(config, first.scene.garment, first.fps)
        sample = sample_of(first)
    if beginning is not None:  # the folder may hold another model tomorrow
        facts["begin_from"] = beginning.digest
        if beginning.other_ring and not (folder / FACTS_NAME).is_file():
            say(
                f"column_rnn: begins afresh, for that of {config.training.begin_from} has "
                f"{beginning.other_ring}; to go on from it take the [column_rnn] values of its config.toml"
            )
    check_run(folder, config, facts=facts)  # before another run's cache is written into
    clips = clips_folder(config.simulation, folder)
    for place in (folder, folder / CACHE, clips, *(folder / CHECKPOINTS).glob("*")):
        sweep(place)  # what a killed run left, also where nothing is missing and so nothing is written
    data = prepare(data_dir, config, folder / CACHE, unposed=unposed and not simulating)
    if check is not None:
        check(data)
    if simulating:
        check_motions(config.simulation, data)
    if devices.first:
        prepare_run(folder, config, facts=facts | {"data": data.content})
    if simulating:
        more = make_simulated_clips(data, config, folder, say=say)
        data = prepare(data_dir, config, folder / CACHE, more=more, unposed=unposed)
        _check_begun_with(folder, clips, data.content)
        if devices.first:
            prepare_run(folder, config, facts=facts | {"simulated": data.content})
    if beginning is not None:
        data = data._replace(statistics=beginning.statistics)
    if not (folder / SCENE).is_file():  # so that what is saved of the run animates without its clips
        write_sample(folder, sample)
    template = scene_template(data.scene, data.statistics, config)
    skinned = make_start(template, data.seeds, config.body.tau)
    log = RunLog(folder, tensorboard=tensorboard, silent=not devices.first)
    return Run(config, folder, data, template, skinned, log, devices)


def _check_begun_with(folder: Path, clips: Path, content: str) -> None:
    """Raise `ValueError` for a run with checkpoints that learnt from other simulated clips than these."""
    if any((folder / CHECKPOINTS).glob("*/*")) and run_facts(folder).get("simulated") != content:
        raise ValueError(
            f"{folder} has learnt from other simulated clips than {clips} holds; train into another "
            "--run-dir."
        )


def checkpointer(run: Run, stage: str) -> Checkpointer:
    """Return the stage's checkpoints, which describe the model completely."""
    statistics = {name: np.asarray(x).tolist() for name, x in run.template.statistics._asdict().items()}
    metadata = {
        "config": to_dict(run.config),
        "config_hash": content_hash(run.config),
        "garment_hash": garment_hash(run.data.scene.garment),
        "vertices": len(run.template.T),
        "fps": run.data.fps,
        "statistics": statistics,
    }
    if stage == "column_rnn":
        from garment_jax.model.column_rnn.tables import seen_body

        metadata["seen"] = seen_body(run.data.scene).described()
    return Checkpointer(run.folder, stage, metadata=metadata)


def optimise(
    run: Run,
    stage: str,
    params: dict,
    make_step: Callable[[optax.GradientTransformation], StepFn],
    batch_at: Callable[[int], Any],
    *,
    steps: int,
    learning_rate: float,
    weight_decay: float,
    seed: int,
    frames_per_step: int,
    carry: Any = (),
    validate: Callable[[dict], Mapping[str, float]] | None = None,
    players: Callable[[optax.GradientTransformation], optax.GradientTransformation] | None = None,
    axes: Any = 0,
) -> dict:
    """Train one stage from `params` and return its parameters; goes on from the newest checkpoint.

    make_step  optimiser -> (`TrainState`, batch) -> (state, metrics), which may donate the state
    batch_at   as in `run_stage`; of several processes each makes its own `run.devices.rows`
    seed       of the state's key
    carry      recurrent state that the first step begins with
    validate   parameters -> figures, every `training.validate_every` steps
    players    the optimiser of all parameters, out of that of one player
    axes       of a batch's leaves: which one counts lanes, or frames, and is split over devices

    With `training.average` the parameters that are returned, validated and stored are a mean.
    """
    training = run.config.training
    optimiser = make_optimiser(training, learning_rate=learning_rate, weight_decay=weight_decay, steps=steps)
    optimiser = optimiser if players is None else players(optimiser)
    state: Any = TrainState(params, optimiser.init(params), jax.random.key(seed), jnp.int32(0), carry)
    step_fn = make_step(optimiser)
    if training.average:
        state, step_fn = with_average(state, step_fn, steps=steps, part=training.average)
    last = run_stage(
        stage,
        state,
        step_fn,
        lambda step: run.devices.put(batch_at(step), axes),
        steps=steps,
        checkpointer=checkpointer(run, stage),
        logger=run.log,
        checkpoint_seconds=training.checkpoint_seconds,
        validate=None if validate is None else lambda state: validate(state.params),
        validate_every=training.validate_every,
        log_every=training.log_every,
        frames_per_step=frames_per_step,
        devices=run.devices,
    )
    return run.devices.local(last.params)


def say(text: str) -> None:
    """Print a line of progress on standard error."""
    print(text, file=sys.stderr, flush=True)
