"""Many clips into files: simulated (`many.py`), screened, written, and gone on with clip by clip."""

import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from garment_jax.evaluation.penetration import neighbour_faces
from garment_jax.farm.local import LocalFarm
from garment_jax.farm.shard import Shard
from garment_jax.farm.work import Farm
from garment_jax.io.content_hash import scene_hash, stored_attribute, stored_hash
from garment_jax.io.overwrite_checks import COLLIDED, RESTARTED
from garment_jax.io.sequence_writer import INT16_REACH, SequenceWriter
from garment_jax.simulation.many import AT_ONCE, Task, check_at_once, simulate_many
from garment_jax.simulation.screening import Screen, ScreenLimits, faults, screen_clip
from garment_jax.simulation.settings import ClothSettings
from garment_jax.simulation.start import check_motion
from garment_jax.storage.lock import NAME, lock_name, locked
from garment_jax.storage.scratch import sweep
from garment_jax.storage.whole import replaced
from garment_jax.structs import Motion, Scene

ENGINE = "newton SolverStyle3D"


class Job(NamedTuple):
    """One clip to simulate."""

    name: str
    split: str  # "train" or "test": the folder it goes to
    motion: Motion
    made_from: str = ""  # names of the clips that it is a variation of


class _Output(NamedTuple):
    """What a clip's screening and its file need, beside the scene."""

    job: Job
    path: Path
    settings: ClothSettings
    limits: ScreenLimits
    key: str


class Outcome(NamedTuple):
    """What became of a clip."""

    job: str
    path: Path | None  # None when it was left out
    seconds: float  # 0 for one that was there already
    screen: Screen | None
    faults: list[str]  # why it was left out, in words
    error: str = ""  # why it could not be made, though it might be another time: a full disk, a lost worker


def simulate_clips(
    scene: Scene,
    jobs: Sequence[Job],
    out: Path,
    settings: ClothSettings,
    *,
    flat: np.ndarray | None = None,
    workers: int = 1,
    farm: Farm | None = None,
    shard: Shard | None = None,
    device: str = "cpu",
    at_once: int = AT_ONCE,
    limits: ScreenLimits = ScreenLimits(),
    progress: Callable[[str], None] = print,
) -> list[Outcome]:
    """Simulate `jobs` into `out/SPLIT/NAME.h5`; return their outcomes in the jobs' order.

    A clip that is there already, of the same content, is kept: an interrupted call goes on where it was.
    One that was simulated with other settings, in this garment and body, is made anew; no other file is
    replaced. One process at a time simulates into `out`, or one for each `shard`, whose part of `jobs` alone
    is simulated. The drape from rest is computed once. `flat` `[u, 2]` is the flat pattern in metres. On a
    CPU each worker of `farm` (`workers` processes) simulates a clip; on another `device` `at_once` clips are
    simulated side by side (`SideBySide`). A clip that fails, or fails the screening, is named, with the
    reason, and no file is left. `progress` gets a line for every clip; frames are counted on stderr. Raises
    `ValueError` or `OSError` before anything is simulated for what could not be simulated or written, and
    for a file of a clip's name that must not be replaced.
    """
    paths = [out / job.split / f"{job.name}.h5" for job in jobs]
    check_at_once(at_once)
    farm = LocalFarm(workers) if farm is None else farm
    _check_surface(scene)
    _check_jobs(scene, jobs, paths, settings)
    _check_folder(out)
    held = NAME
    if shard is not None:
        jobs, paths, held = shard.of(jobs), shard.of(paths), lock_name(f"shard {shard}")
        progress(f"shard {shard}: {len(jobs)} clips")
    with locked(out, "simulating clips", name=held):
        return _simulate_missing(
            scene, jobs, paths, out, settings, flat, farm, device, at_once, limits, progress
        )


def _simulate_missing(
    scene: Scene,
    jobs: Sequence[Job],
    paths: list[Path],
    out: Path,
    settings: ClothSettings,
    flat: np.ndarray | None,
    farm: Farm,
    device: str,
    at_once: int,
    limits: ScreenLimits,
    progress: Callable[[str], None],
) -> list[Outcome]:
    keys = [content_key(scene, job.motion, settings, flat) for job in jobs]
    for path, key in zip(paths, keys, strict=True):
        _check_replaceable(path, key, scene)
    for job, path, key in zip(jobs, paths, keys, strict=True):
        _take_over(job, path, key, out)
    todo = [i for i in range(len(jobs)) if stored_hash(paths[i]) != keys[i]]
    outcomes: dict[int, Outcome] = {
        i: Outcome(jobs[i].name, paths[i], 0.0, None, []) for i in range(len(jobs)) if i not in todo
    }
    if len(todo) < len(jobs):
        progress(f"{len(jobs) - len(todo)} of {len(jobs)} clips are there already")
    for folder in {path.parent for path in paths}:
        sweep(folder)  # what a run left that was killed between writing and tidying
    if not todo:
        return [outcomes[i] for i in range(len(jobs))]
    outputs = {i: _Output(jobs[i], paths[i], settings, limits, keys[i]) for i in todo}
    tasks = {i: Task(jobs[i].name, jobs[i].motion, partial(_finish, outputs[i])) for i in todo}
    running = simulate_many(
        scene, tasks, settings, flat=flat, farm=farm, device=device, at_once=at_once, progress=progress
    )
    began, done, total = time.perf_counter(), 0, sum(len(jobs[i].motion.root) for i in todo)
    for i, done_one in running:
        outcome = done_one.value
        if done_one.error:
            paths[i].unlink(missing_ok=True)  # one of other settings
            outcome = Outcome(jobs[i].name, None, 0.0, None, [done_one.error], done_one.error)
        outcomes[i] = outcome
        done += len(jobs[i].motion.root)
        seconds = time.perf_counter() - began
        verdict = "left out: " + "; ".join(outcome.faults) if outcome.faults else "kept"
        progress(
            f"{outcome.job}: {len(jobs[i].motion.root)} frames in {outcome.seconds:.0f} s, {verdict}; "
            f"{done}/{total} frames, {seconds / done * (total - done):.0f} s left"
        )
    return [outcomes[i] for i in range(len(jobs))]


def _check_surface(scene: Scene) -> None:
    faces = scene.body.faces if scene.collider is None else scene.collider.faces
    if not len(faces):
        raise ValueError("the body has 0 faces to touch; give it some, or a collider that has.")
    if scene.collider is not None:
        neighbour_faces(faces)  # an open one has no inside: penetration would go unseen


def _check_jobs(scene: Scene, jobs: Sequence[Job], paths: Sequence[Path], settings: ClothSettings) -> None:
    """Refuse now what engine and writer would refuse once the cloth is draped, or a clip simulated."""
    for i, (job, path) in enumerate(zip(jobs, paths, strict=True)):
        if path in paths[:i]:
            raise ValueError(
                f"two clips would be written to {path}; simulate one of them into another folder."
            )
        check_motion(job.motion, scene.body, settings, job.name)
        SequenceWriter(path, scene, job.motion)  # checks when it is made, writes when it is entered


def _check_replaceable(path: Path, key: str, scene: Scene) -> None:
    """Raise `ValueError` where a clip would replace what was not simulated here, or of another garment."""
    if not os.path.lexists(path) or stored_hash(path) == key:
        return
    others = ("source", "imported_from", COLLIDED, RESTARTED)
    made = [stored_attribute(path, name) for name in ("kind", "engine", *others)]
    if made != ["simulated", ENGINE, *[None] * len(others)]:
        raise ValueError(
            f"{path} is there and simulate did not make it; choose another --out, or move it away."
        )
    if stored_attribute(path, "scene_hash") != scene_hash(scene):
        raise ValueError(
            f"{path} is there, a clip of another garment or body; choose another --out, or move it away."
        )


def _take_over(job: Job, path: Path, key: str, out: Path) -> None:
    """Move a clip that is now to be tested on, or trained on, out of the other folder: never in both."""
    elsewhere = out / ("train" if job.split == "test" else "test") / path.name
    if not elsewhere.exists():
        return
    if stored_hash(elsewhere) != key:
        raise ValueError(
            f"{elsewhere} is there and {path} would be another clip of that name: one to train on must not "
            "be one to test on; move it away."
        )
    with replaced(path) as (made,):
        shutil.copyfile(elsewhere, made)
        with h5py.File(made, "r+") as file:
            file.attrs["split"] = job.split
    elsewhere.unlink()


def _check_folder(out: Path) -> None:
    """Raise OSError if nothing can be written in `out`, which need not be there yet."""
    nearest = next(folder for folder in (out, *out.parents) if folder.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK):
        reason = "may not be written to" if nearest.is_dir() else "is no folder"
        raise OSError(f"{out}: {nearest} {reason}; choose another folder.")


def content_key(scene: Scene, motion: Motion, settings: ClothSettings, flat: np.ndarray | None) -> str:
    """Return 16 hexadecimal digits of all that a simulated clip depends on."""
    digest = hashlib.sha256(scene_hash(scene).encode())
    cloth, usual = asdict(settings), ClothSettings()
    for key in ("bend_bias", "turn_in"):  # came later: older clips are kept
        if cloth[key] == getattr(usual, key):
            del cloth[key]
    digest.update(json.dumps([cloth, motion.fps], sort_keys=True).encode())
    carried = [array for part in (scene.collider, scene.pins) if part is not None for array in part]
    for array in (motion.rotations, motion.root, flat, *carried):
        digest.update(b"" if array is None else np.ascontiguousarray(array, "<f4").tobytes())
    return digest.hexdigest()[:16]


def check_made(outcomes: Sequence[Outcome]) -> None:
    """Raise `OSError` where a clip could not be made, for a caller that cannot do without."""
    for outcome in outcomes:
        if outcome.error:
            raise OSError(f"{outcome.job}: {outcome.error}")


def _finish(output: _Output, scene: Scene, V: np.ndarray, seconds: float, machine: str) -> Outcome:
    """Screen and write a clip that was simulated in `seconds` on `machine`."""
    job, path, settings, limits, key = output
    try:
        screen = screen_clip(scene, job.motion, V)
    except ValueError as error:
        path.unlink(missing_ok=True)
        return Outcome(job.name, None, seconds, None, [str(error)])
    wrong = faults(screen, limits)
    if wrong:
        path.unlink(missing_ok=True)  # one of other settings, which would be trained on beside the new ones
        return Outcome(job.name, None, seconds, screen, wrong)
    attributes = {
        "name": job.name,
        "split": job.split,
        "kind": "simulated",
        "engine": ENGINE,
        "settings": settings.describe(),
        "content_hash": key,
        "screen": json.dumps(screen._asdict()),
        "simulated_on": machine,
    }
    if job.made_from:
        attributes["made_from"] = job.made_from
    far = np.abs(V - job.motion.root[:, None]).max() > INT16_REACH
    encoding = "float32" if far else "int16"
    with SequenceWriter(path, scene, job.motion, encoding=encoding, attributes=attributes) as writer:
        writer.append(V)
    return Outcome(job.name, path, seconds, screen, [])
