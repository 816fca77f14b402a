"""Training clips straight from the simulator, in place of the recorded ones; they are never written."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from garment_jax.body.seeds import Seeds
from garment_jax.config import Config, SimulationConfig
from garment_jax.dataset.lanes import check_window
from garment_jax.dataset.prepared import DataSet, PreparedClip, mirror_image, prepared_in_memory
from garment_jax.dataset.template import canonical_weights
from garment_jax.simulation.command import read_pattern
from garment_jax.simulation.drawn_motions import drawn_motions
from garment_jax.simulation.many import Task, simulate_many
from garment_jax.simulation.screening import shape_faults
from garment_jax.simulation.settings import ClothSettings, parse_cloth
from garment_jax.structs import Motion, Scene


def with_simulated_clips(
    data: DataSet,
    config: Config,
    *,
    posed: bool,
    unposed: bool,
    windows: Mapping[str, int],
    say: Callable[[str], None],
) -> DataSet:
    """Return `data` with clips to train on that are simulated, on motions drawn out of its own.

    With mirror images where `data` has them. A function of configuration, seed and device: a resumed run
    simulates the same clips again. Clips whose cloth bunched or was stretched are left out. `posed` and
    `unposed`: whether the canonical pose's targets and T_tilde are wanted; `windows`: frames by stage.
    Raises `ValueError` as `check_simulation`, and where no motion holds a window or no clip is kept.
    """
    wanted, scene = config.simulation, data.scene
    settings, flat = _cloth(wanted, data.fps)
    motions = drawn_motions(
        [clip.motion for clip in data.train if not clip.mirrored],
        scene.body,
        wanted.clips,
        seed=config.training.seed,
        longest=wanted.longest,
        workers=wanted.workers,
    )
    for stage, window in windows.items():
        check_window([len(motion.root) for motion in motions], window, stage)
    finish = partial(
        _prepared,
        scene=scene,
        seeds=data.seeds,
        W=canonical_weights(scene, config) if posed else None,
        config=config,
        unposed=unposed,
        mirrored=data.mirror is not None,
    )
    tasks = {k: Task(f"clip {k + 1}", m, partial(finish, f"clip {k + 1}", m)) for k, m in enumerate(motions)}
    made: dict[int, list[PreparedClip]] = {}
    for k, clips in simulate_many(
        scene,
        tasks,
        settings,
        flat=flat,
        workers=wanted.workers,
        device=wanted.device,
        at_once=wanted.at_once,
        progress=say,
    ):
        made[k] = clips
        if len(made) % max(len(motions) // 10, 1) == 0:
            say(f"{len(made)} of {len(motions)} clips are simulated")
    kept = [clip for k in range(len(motions)) for clip in made[k]]
    if not kept:
        raise ValueError(
            f"none of {len(motions)} simulated clips can be learnt from: in all of them cloth bunched or was "
            "stretched; look at some that garment-jax simulate varied writes with this cloth."
        )
    frames = sum(len(clip.V) for clip in kept if not clip.mirrored)
    say(f"{sum(map(bool, made.values()))} of {len(motions)} simulated clips are kept, {frames} frames")
    return data._replace(train=kept)


def check_simulation(config: SimulationConfig, fps: float, windows: Mapping[str, int]) -> None:
    """Raise `ValueError` or `OSError` for what could not be simulated, before anything is trained."""
    settings, _ = _cloth(config, fps)
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


def _prepared(
    name: str,
    motion: Motion,
    V: np.ndarray,
    _seconds: float,
    _machine: str,
    *,
    scene: Scene,
    seeds: Seeds,
    W: np.ndarray | None,
    config: Config,
    unposed: bool,
    mirrored: bool,
) -> list[PreparedClip]:
    """Return a simulated clip `V` `[t, n, 3]` (world metres) and its mirror image; none if it is useless."""
    if shape_faults(scene, motion, V):
        return []
    clip = prepared_in_memory(name, motion, V, scene, seeds, W, config, unposed=unposed)
    return [clip, mirror_image(clip, scene, seeds, config)] if mirrored else [clip]
