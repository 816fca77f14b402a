"""Frames a second of every training stage, and the memory that train.py needs.

    python benchmarks/training_speed.py CONFIG DATA [--steps 60] [--cache RUN/cache] [--json FILE]

Trains in a temporary folder for a few steps a stage, with everything that train.py does but for the long
wait. `--cache` takes the prepared clips of an earlier run (read only) instead of computing them again.
"""

import argparse
import tempfile
from pathlib import Path

from measured import report
from short_training import few_steps, stage_speeds

from garment_jax.config import load_config
from garment_jax.machine import peak_mb


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("data", type=Path)
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--stage", default="all")
    parser.add_argument("--cache", type=Path)
    parser.add_argument("--json", type=Path)
    options, overrides = parser.parse_known_args()
    config = few_steps(
        load_config(options.config, overrides), options.steps, log_every=max(options.steps // 12, 1)
    )
    with tempfile.TemporaryDirectory() as name:
        cache = Path(name) / "run" / "cache"
        cache.mkdir(parents=True)
        for prepared in options.cache.glob("*.npy") if options.cache else ():
            (cache / prepared.name).symlink_to(prepared.resolve())
        rows = stage_speeds(config, options.data, Path(name) / "run", stage=options.stage)
    facts = {"config": str(options.config), "peak memory MB": round(peak_mb())}
    report(rows, title="Training speed", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
