"""Clips simulated to train on, beside the recorded ones: made once, in the run's folder."""

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from garment_jax.config import Config, SimulationConfig
from garment_jax.dataset.prepared import DataSet
from garment_jax.simulation.command import read_pattern
from garment_jax.simulation.drawn_motions import check_kinds, drawn_motions, parse_kinds
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
    known = _Known(out)
    if known.whole():
        return known.files()
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
    jobs = [job for job in jobs if job.name not in known.left_out]
    say(f"simulating {len(jobs)} clips, {sum(len(job.motion.root) for job in jobs)} frames, into {out}")
    outcomes = simulate_clips(
        data.scene, jobs, out, settings,
        flat=flat, workers=wanted.workers, device=wanted.device, at_once=wanted.at_once, progress=say,
    )  # fmt: skip
    known.kept = [outcome.job for outcome in outcomes if outcome.path is not None]
    known.left_out |= {outcome.job: outcome.faults for outcome in outcomes if outcome.path is None}
    if not known.kept:
        raise ValueError(
            f"none of {len(motions)} simulated clips can be learnt from, for the reasons above; give "
            "simulation.cloth other settings, or simulation.kinds calmer ones."
        )
    say(f"{len(known.kept)} of {len(motions)} simulated clips are kept")
    known.write()
    return known.files()


class _Known:
    """What became of all clips once, so that those left out are not simulated at every call."""

    def __init__(self, out: Path) -> None:
        self._out = out
        self.kept: list[str] = []
        self.left_out: dict[str, list[str]] = {}
        with suppress(OSError, ValueError, KeyError, TypeError):  # none yet, or damaged: found out again
            found = json.loads((out / DRAWN).read_text(encoding="utf-8"))
            self.kept, self.left_out = list(found["kept"]), dict(found["left_out"])

    def files(self) -> list[Path]:
        return [self._out / "train" / f"{name}.h5" for name in self.kept]

    def whole(self) -> bool:
        return bool(self.kept) and all(file.is_file() for file in self.files())

    def write(self) -> None:
        text = json.dumps({"kept": self.kept, "left_out": self.left_out}, indent=1)
        write_text(self._out / DRAWN, text + "\n")


def check_simulation(config: SimulationConfig) -> None:
    """Raise `ValueError` or `OSError` for what could not be simulated, before any clip is read."""
    settings, _ = _cloth(config, ClothSettings().fps)
    parse_kinds(config.kinds)
    import garment_jax.simulation.engine  # noqa: F401  (raises where it is not installed)

    if config.device == "cpu":
        return
    from garment_jax.simulation.side_by_side import check_settings, find_device

    check_settings(settings)
    find_device(config.device)


def check_motions(config: SimulationConfig, data: DataSet) -> None:
    """Raise `ValueError` where the recorded motions are too few for every kind."""
    check_kinds(parse_kinds(config.kinds), sum(not clip.mirrored for clip in data.train))


def _cloth(config: SimulationConfig, fps: float) -> tuple[ClothSettings, np.ndarray | None]:
    settings = replace(parse_cloth(config.cloth, "simulation.cloth"), fps=fps)
    return settings, read_pattern(Path(config.pattern)) if config.pattern else None
