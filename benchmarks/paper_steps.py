"""The first steps of every stage at the paper's size: 9,352 vertices, UV maps of 256 x 256.

    python benchmarks/paper_steps.py [--config configs/paper.toml] [--steps 5] [--stage all] [--json FILE]

The garment is a cone grid of 9,352 vertices on a small body, its motion and its folds are made in code: what
counts here is that the networks build, fit and take steps. Nothing of the configuration is made smaller
but the number of steps.
"""

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from garment_jax.bench.figures import report
from garment_jax.machine import peak_mb

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the scene made in code lives with the tests
from garment_jax.config import Config, load_config
from garment_jax.training.devices import ONE, Devices
from garment_jax.training.log import read_log
from garment_jax.training.pipeline import train
from tests.reference.scene import make_motion, make_scene, write_clip

RINGS, COLUMNS = 56, 167
NEVER = 1e9  # seconds


def few_steps(config: Config, steps: int, *, log_every: int) -> Config:
    """Return `config` with `steps` steps in every stage (no warm-up stays none) and few interruptions."""
    motion = config.motion
    return replace(
        config,
        generative=replace(config.generative, steps=steps),
        motion=replace(motion, steps=steps, warm_up_steps=min(motion.warm_up_steps, steps)),
        detail=replace(config.detail, steps=min(config.detail.steps, steps)),
        column_rnn=replace(config.column_rnn, steps=min(config.column_rnn.steps, steps)),
        training=replace(config.training, log_every=log_every, checkpoint_seconds=NEVER, validate_every=0),
    )


def stage_speeds(
    config: Config, data_dir: Path, folder: Path, *, stage: str = "all", devices: Devices = ONE
) -> list[dict]:
    """Train in `folder` and return each stage's seconds a step and frames a second, steps after the first
    logged ones (which compile) alone; batches, logging and the rest of the loop included."""
    train(config, folder, data_dir=data_dir, stage=stage, devices=devices)
    motion = config.motion
    frames = {
        "generative": config.generative.batch,
        "warm_up": motion.warm_up_lanes * motion.window,
        "motion": motion.lanes * motion.window,
        "detail": config.detail.batch,
        "column_rnn": config.column_rnn.lanes * config.column_rnn.window,
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, default=Path("configs/paper.toml"))
    parser.add_argument("--steps", type=int, default=5)
    parser.add_argument("--stage", default="all")
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--json", type=Path)
    options, overrides = parser.parse_known_args()
    config = few_steps(load_config(options.config, overrides), options.steps, log_every=1)
    scene = make_scene(RINGS, COLUMNS)
    with tempfile.TemporaryDirectory() as name:
        data = Path(name) / "data"
        motion = make_motion(scene, options.frames)
        write_clip(data / "train" / "dance.h5", scene=scene, motion=motion, attributes={"name": "dance"})
        rows = stage_speeds(config, data, Path(name) / "run", stage=options.stage)
    facts = {
        "config": str(options.config),
        "vertices": len(scene.garment.template),
        "UV": config.uv.size,
        "peak memory MB": round(peak_mb()),
    }
    report(rows, title="The paper's size", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
