"""The first steps of every stage, and the hours that all of a configuration's steps take at that speed.

    python benchmarks/stage_steps.py [--config configs/paper.toml] [--data DIR] [--steps 5]
        [--stage all] [--json FILE]

Without clips (`--data`) the garment is of the paper's size, a cone grid of 9,352 vertices on a small body;
its motion and its folds are made in code: what counts then is that the networks build, fit and take steps.
Nothing of the configuration is made smaller but the number of steps; no clips are simulated.
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
from garment_jax.io.sequence import open_sequence
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
        simulation=replace(config.simulation, clips=0),
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
    parser.add_argument("--data", type=Path, help="folder of clips (default: a cone grid made in code)")
    parser.add_argument("--steps", type=int, default=5)
    parser.add_argument("--stage", default="all")
    parser.add_argument("--frames", type=int, default=120, help="of the motion made in code")
    parser.add_argument("--json", type=Path)
    options, overrides = parser.parse_known_args()
    whole = load_config(options.config, overrides)
    config = few_steps(whole, options.steps, log_every=1)
    with tempfile.TemporaryDirectory() as name:
        data = options.data or made_in_code(Path(name) / "data", options.frames)
        if not options.data:
            config = replace(config, data=replace(config.data, validation=()))
        rows = stage_speeds(config, data, Path(name) / "run", stage=options.stage)
        with open_sequence(min((data / "train").glob("*.h5"))) as clip:
            vertices = len(clip.scene.garment.template)
    for row in rows:
        row["all steps"] = all_steps(whole)[row["stage"]]
        row["h"] = round(row["all steps"] * row["s/step"] / 3600, 2)
    facts = {
        "config": str(options.config),
        "vertices": vertices,
        "UV": config.uv.size,
        "peak memory MB": round(peak_mb()),
    }
    report(rows, title="Steps of every stage", facts=facts, json_path=options.json)


def made_in_code(folder: Path, frames: int) -> Path:
    """Write one clip of the paper's size into `folder` and return that."""
    scene = make_scene(RINGS, COLUMNS)
    motion = make_motion(scene, frames)
    write_clip(folder / "train" / "dance.h5", scene=scene, motion=motion, attributes={"name": "dance"})
    return folder


def all_steps(config: Config) -> dict[str, int]:
    """Return how many steps the configuration has, by stage."""
    return {
        "generative": config.generative.steps,
        "warm_up": config.motion.warm_up_steps,
        "motion": config.motion.steps,
        "detail": config.detail.steps,
        "column_rnn": config.column_rnn.steps,
    }


if __name__ == "__main__":
    main()
