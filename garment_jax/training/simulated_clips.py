"""Clips simulated to train on, beside the recorded ones: once, in the folder of a run or of several."""

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from garment_jax.config import Config, SimulationConfig
from garment_jax.dataset.prepared import DataSet
from garment_jax.io.content_hash import scene_hash
from garment_jax.simulation.command import read_pattern
from garment_jax.simulation.drawn_motions import check_kinds, drawn_motions, parse_kinds
from garment_jax.simulation.settings import ClothSettings, parse_cloth
from garment_jax.storage.whole import write_text
from garment_jax.structs import Motion, Scene

CLIPS, DRAWN = "clips", "drawn.json"  # inside a run
_ASKED = ("clips", "kinds", "longest", "cloth", "pattern", "seed")  # what makes other clips
# Bytes a vertex and frame: what a clip's file takes, and what prepared frames do (V and T_tilde, float32)
PACKED, PREPARED = 6, 24


def make_simulated_clips(
    data: DataSet, config: Config, folder: Path, *, say: Callable[[str], None]
) -> list[Path]:
    """Return clips of motions drawn out of those of `data`, in `simulation.dir` or a run's `folder`.

    What is there is kept: a stopped run goes on clip by clip, and one that has them all draws no motion.
    Clips that fail the screening are named and left out. A function of configuration, seed and device.
    Raises `ValueError` as `check_simulation`, where no clip passes and for a folder of clips that were drawn
    otherwise, and `OSError` where they would not find room.
    """
    from garment_jax.simulation.clips import Job, check_made, simulate_clips

    out, wanted = clips_folder(config.simulation, folder), config.simulation
    recorded = [clip.motion for clip in data.train if not clip.mirrored]
    asked = {name: getattr(wanted, name) for name in _ASKED} | {"of": _digest(data.scene, recorded)}
    known = _Known(out, asked)
    if known.whole():
        return known.files()
    settings, flat = _cloth(wanted, data.fps)
    motions = drawn_motions(
        recorded,
        data.scene.body,
        wanted.clips,
        kinds=parse_kinds(wanted.kinds),
        seed=wanted.seed,
        longest=wanted.longest,
        workers=wanted.workers,
    )
    jobs = [Job(f"drawn_{k:04d}", "train", motion) for k, motion in enumerate(motions, 1)]
    jobs = [job for job in jobs if job.name not in known.left_out]
    missing = [job for job in jobs if not (out / job.split / f"{job.name}.h5").is_file()]
    _check_room(sum(len(job.motion.root) for job in missing) * len(data.scene.garment.template), out, folder)
    say(f"simulating {len(jobs)} clips, {sum(len(job.motion.root) for job in jobs)} frames, into {out}")
    outcomes = simulate_clips(
        data.scene, jobs, out, settings,
        flat=flat, workers=wanted.workers, device=wanted.device, at_once=wanted.at_once, progress=say,
    )  # fmt: skip
    check_made(outcomes)
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


def _digest(scene: Scene, motions: Sequence[Motion]) -> str:
    """Return the hash of what motions are drawn out of, and of whom they dress."""
    digest = hashlib.sha256(scene_hash(scene).encode())
    for motion in motions:
        for array in (motion.rotations, motion.root):
            digest.update(np.ascontiguousarray(array, "<f4").tobytes())
    return digest.hexdigest()[:16]


def clips_folder(config: SimulationConfig, run: Path) -> Path:
    """Return where the simulated clips of the run in a folder are."""
    return Path(config.dir) if config.dir else run / CLIPS


def _check_room(size: int, clips: Path, run: Path) -> None:
    """Raise `OSError` where clips of `size` frames times vertices, or their prepared frames, find no room."""
    places = {"clips": (clips, PACKED * size), "prepared frames": (run, PREPARED * size)}
    for what, (place, bytes_) in places.items():
        free = shutil.disk_usage(next(p for p in (place, *place.absolute().parents) if p.is_dir())).free
        if bytes_ > free:
            raise OSError(
                f"the {what} take up to {bytes_ / 1e9:.3g} GB in {place}, where {free / 1e9:.3g} GB are "
                "free; make room, or give simulation.clips a smaller number."
            )


class _Known:
    """What became of all clips once, so that those left out are not simulated at every call."""

    def __init__(self, out: Path, asked: dict[str, Any]) -> None:
        self._out, self._asked = out, json.loads(json.dumps(asked))
        found = self._found()
        if found and found["asked"] != self._asked:
            name = next((k for k, v in self._asked.items() if found["asked"].get(k) != v), "of")
            what = "out of other clips" if name == "of" else f"with another simulation.{name}"
            raise ValueError(f"{out} holds clips that were drawn {what}; name another simulation.dir or run.")
        self.kept: list[str]
        self.left_out: dict[str, list[str]]
        self.kept, self.left_out = found.get("kept", []), found.get("left_out", {})

    def _found(self) -> dict[str, Any]:
        """Return what is written there; empty where there is none yet, or it is damaged: found out again."""
        with suppress(OSError, ValueError, KeyError, TypeError):
            found = json.loads((self._out / DRAWN).read_text(encoding="utf-8"))
            kept, left_out = list(found["kept"]), dict(found["left_out"])
            return {"asked": dict(found["asked"]), "kept": kept, "left_out": left_out}
        return {}

    def files(self) -> list[Path]:
        return [self._out / "train" / f"{name}.h5" for name in self.kept]

    def whole(self) -> bool:
        return bool(self.kept) and all(file.is_file() for file in self.files())

    def write(self) -> None:
        text = json.dumps({"asked": self._asked, "kept": self.kept, "left_out": self.left_out}, indent=1)
        write_text(self._out / DRAWN, text + "\n")


def check_simulation(config: SimulationConfig) -> None:
    """Raise `ValueError` or `OSError` for what could not be simulated, before any clip is read."""
    _cloth(config, ClothSettings().fps)
    parse_kinds(config.kinds)
    if config.dir and Path(config.dir).is_file():
        raise ValueError(f"simulation.dir {config.dir} is a file; name a folder.")
    from garment_jax.simulation.engine import find_device  # raises where the engine is not installed

    if config.device != "cpu":
        find_device(config.device)


def check_motions(config: SimulationConfig, data: DataSet) -> None:
    """Raise `ValueError` where the recorded motions are too few for every kind."""
    check_kinds(parse_kinds(config.kinds), sum(not clip.mirrored for clip in data.train))


def _cloth(config: SimulationConfig, fps: float) -> tuple[ClothSettings, np.ndarray | None]:
    settings = replace(parse_cloth(config.cloth, "simulation.cloth"), fps=fps)
    return settings, read_pattern(Path(config.pattern)) if config.pattern else None
