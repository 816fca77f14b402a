"""The first steps of every stage at the paper's size: 9,352 vertices, UV maps of 256 x 256.

    python benchmarks/paper_steps.py [--config configs/paper.toml] [--steps 5] [--stage all] [--json FILE]

The garment is a cone grid of 9,352 vertices on a small body, its motion and its folds are made in code: what
counts here is that the networks build, fit and take steps. Nothing of the configuration is made smaller
but the number of steps.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from measured import report
from short_training import few_steps, stage_speeds

from garment_jax.machine import peak_mb

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the scene made in code lives with the tests
from garment_jax.config import load_config
from tests.reference.scene import make_motion, make_scene, write_clip

RINGS, COLUMNS = 56, 167


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
