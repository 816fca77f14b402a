"""Clips simulated to train on, beside the recorded ones: made once, in the run's folder."""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from garment_jax.config import Config, SimulationConfig
from garment_jax.dataset.lanes import check_window
from garment_jax.dataset.prepared import DataSet
from garment_jax.simulation.command import read_pattern
from garment_jax.simulation.drawn_motions import drawn_motions, parse_kinds
from garment_jax.simulation.settings import ClothSettings, parse_cloth
from garment_jax.storage.whole import write_text

CLIPS, DRAWN = "clips", "drawn.json"  # inside a run


def make_simulated_clips(
    data: DataSet, config: Config, folder: Path, *, say: Callable[[str], None]
) -> list[Path]:
    """Return the clips of a run's `folder`, simulated on motions drawn out of those of `data`.

    What is there is kept: a stopped run goes on clip by clip, and one that has them all draws no motion.
    Clips that fail the screening are named and left out. A function of configuration, seed and device.
    Raises `ValueError` as `check_simulation`, and where no clip passes.
    """
    from garment_jax.simulation.clips import Job, simulate_clips

    out, wanted = folder / CLIPS, config.simulation
    known = out / DRAWN
    if known.is_file():
        files = [out / "train" / name for name in json.loads(known.read_text(encoding="utf-8"))]
        if all(file.is_file() for file in files):
            return files
    settings, flat = _cloth(wanted, data.fps)
    motions = drawn_motions(
        [clip.motion for clip in data.train if not clip.mirrored],
        data.scene.body,
        wanted.clips,
        kinds=parse_kinds(wanted.kinds),
        seed=config.training.seed,
        longest=wanted.longest,
        workers=wanted.workers,
    )
    jobs = [Job(f"drawn_{k:04d}", "train", motion) for k, motion in enumerate(motions, 1)]
    say(f"simulating {len(jobs)} clips, {sum(len(motion.root) for motion in motions)} frames, into {out}")
    outcomes = simulate_clips(
        data.scene, jobs, out, settings,
        flat=flat, workers=wanted.workers, device=wanted.device, at_once=wanted.at_once, progress=say,
    )  # fmt: skip
    files = [outcome.path for outcome in outcomes if outcome.path is not None]
    if not files:
        raise ValueError(
            f"none of {len(jobs)} simulated clips can be learnt from, for the reasons above; give "
            "simulation.cloth other settings, or simulation.kinds calmer ones."
        )
    say(f"{len(files)} of {len(jobs)} simulated clips are kept")
    write_text(known, json.dumps([file.name for file in files], indent=0) + "\n")
    return files


def check_simulation(config: SimulationConfig, fps: float, windows: Mapping[str, int]) -> None:
    """Raise `ValueError` or `OSError` for what could not be simulated, before anything is.

    `windows`: frames by stage.
    """
    settings, _ = _cloth(config, fps)
    parse_kinds(config.kinds)
    for stage, window in windows.items():
        check_window([config.longest], window, stage)
    import garment_jax.simulation.engine  # noqa: F401  (raises where it is not installed)

    if config.device == "cpu":
        return
    from garment_jax.simulation.side_by_side import check_settings, find_device

    check_settings(settings)
    find_device(config.device)


def _cloth(config: SimulationConfig, fps: float) -> tuple[ClothSettings, np.ndarray | None]:
    settings = replace(parse_cloth(config.cloth, "simulation.cloth"), fps=fps)
    return settings, read_pattern(Path(config.pattern)) if config.pattern else None
