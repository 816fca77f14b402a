"""Seconds of one step: of the simulation, and of each stage of training, measured on a few of them.

Learning rates follow the number of steps, so it has to be known before the first one.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import jax
import numpy as np

from garment_jax.config import Config
from garment_jax.dataset.prepared import prepare
from garment_jax.simulation.settings import ClothSettings
from garment_jax.storage.scratch import scratch
from garment_jax.storage.whole import link_or_copy
from garment_jax.structs import Scene
from garment_jax.training.log import read_log
from garment_jax.training.pipeline import train
from garment_jax.training.run_directory import CACHE

FRAMES = 12  # of the cloth as it settles
MOVING = 1.15  # a moving body takes so much longer than a standing one
STEPS = {"generative": 6, "warm_up": 6, "motion": 5, "detail": 6, "column_rnn": 6}
FIRST = 2  # steps that are not counted: batches made in advance, caches
COMPILED = "/jax/core/compile/backend_compile_duration"  # what JAX calls the event


class Calibration(NamedTuple):
    """What training takes here."""

    seconds_per_step: dict[str, float]
    overhead_seconds: float  # tracing, reading, beginning, of all stages together; compiling is done


def seconds_per_frame(scene: Scene, settings: ClothSettings, flat: np.ndarray | None) -> float:
    """Return the seconds that one process simulates a frame in, of a few frames of settling cloth."""
    from garment_jax.simulation.newton_cloth import drape

    times: list[float] = []
    few = replace(settings, settle=FRAMES)
    drape(scene, few, flat=flat, progress=lambda done, total: times.append(time.monotonic()))
    return MOVING * median(np.diff(times))


def calibrate(config: Config, clips: Path, run: Path) -> Calibration:
    """Return what a step of each stage of `config` takes, from a few steps on the folder `clips`.

    What is prepared of the clips is kept for the training in `run`, and so is what is compiled, where JAX
    keeps it (`warm_start`): numbers of steps are no part of a program.
    """
    with scratch(run.parent) as place:
        first = place / "run"
        (first / CACHE).mkdir(parents=True)
        prepare(clips, config, run / CACHE)
        for file in (run / CACHE).glob("*.npy*"):  # named by what they are of
            link_or_copy(file, first / CACHE / file.name)
        began = time.monotonic()
        with _compiling() as compiling:
            train(with_steps(config, STEPS), first, data_dir=clips)
        seconds = time.monotonic() - began
        if jax.config.jax_compilation_cache_dir:  # type: ignore[attr-defined]
            seconds -= sum(compiling)  # not done again
        per_step = step_seconds(read_log(first, kind="train"))
    counted = sum(STEPS[name] * each for name, each in per_step.items())
    return Calibration(per_step, max(seconds - counted, 0.0))


@contextmanager
def _compiling() -> Iterator[list[float]]:
    """Give a list of the seconds of everything that is compiled meanwhile."""
    seconds: list[float] = []

    def listen(event: str, duration_secs: float, **_: Any) -> None:
        if event == COMPILED:
            seconds.append(duration_secs)

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        yield seconds
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)


def with_steps(config: Config, steps: Mapping[str, int]) -> Config:
    """Return the configuration with other steps of the stages that it trains, each in a line of the log."""
    motion = config.motion
    return replace(
        config,
        generative=replace(config.generative, steps=steps["generative"]),
        motion=replace(motion, steps=steps["motion"], warm_up_steps=steps["warm_up"]),
        detail=replace(config.detail, steps=steps["detail"]),
        column_rnn=replace(config.column_rnn, steps=steps["column_rnn"] if config.column_rnn.steps else 0),
        training=replace(config.training, log_every=1),
    )


def step_seconds(log: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the median seconds of a step by stage, of a log with a line for every step."""
    stages = dict.fromkeys(entry["stage"] for entry in log)
    times = {name: [entry["seconds"] for entry in log if entry["stage"] == name] for name in stages}
    return {name: max(median(np.diff(seconds[FIRST:])), 1e-3) for name, seconds in times.items()}
