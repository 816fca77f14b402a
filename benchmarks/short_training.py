"""A training of a few steps a stage, run as train.py runs it, and its speed read from its log."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from garment_jax.config import Config
from garment_jax.training.log import read_log
from garment_jax.training.pipeline import train

NEVER = 1e9  # seconds


def few_steps(config: Config, steps: int, *, log_every: int) -> Config:
    """Return `config` with `steps` steps in every stage (no warm-up stays none) and few interruptions."""
    motion = config.motion
    return replace(
        config,
        generative=replace(config.generative, steps=steps),
        motion=replace(motion, steps=steps, warm_up_steps=min(motion.warm_up_steps, steps)),
        detail=replace(config.detail, steps=min(config.detail.steps, steps)),
        swing=replace(config.swing, steps=min(config.swing.steps, steps)),
        training=replace(config.training, log_every=log_every, checkpoint_seconds=NEVER, validate_every=0),
    )


def stage_speeds(config: Config, data_dir: Path, folder: Path, *, stage: str = "all") -> list[dict]:
    """Train in `folder` and return each stage's seconds a step and frames a second, steps after the first
    logged ones (which compile) alone; batches, logging and the rest of the loop included."""
    train(config, folder, data_dir=data_dir, stage=stage)
    motion = config.motion
    frames = {
        "generative": config.generative.batch,
        "warm_up": motion.warm_up_lanes * motion.window,
        "motion": motion.lanes * motion.window,
        "detail": config.detail.batch,
        "swing": config.swing.lanes * config.swing.window,
    }
    return [
        _speed(name, read_log(folder, stage=name, kind="train"), count)
        for name, count in frames.items()
        if read_log(folder, stage=name)
    ]


def _speed(name: str, log: list[dict], frames: int) -> dict:
    steps = np.diff([entry["step"] for entry in log])
    seconds = np.diff([entry["seconds"] for entry in log]) / steps
    median = float(np.median(seconds)) if len(seconds) else float("nan")
    return {
        "stage": name,
        "steps": log[-1]["step"],
        "s/step": median,
        "frames/step": frames,
        "frames/s": frames / median,
        "first s": log[0]["seconds"],
        "loss first": log[0]["loss"],
        "loss last": log[-1]["loss"],
    }
