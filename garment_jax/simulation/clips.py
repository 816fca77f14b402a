"""Many clips: simulated by several processes, screened, written, and gone on with clip by clip."""

import hashlib
import json
import multiprocessing
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import numpy as np

from garment_jax.data.content_hash import scene_hash, stored_hash
from garment_jax.data.sequence import SequenceWriter
from garment_jax.evaluation.penetration import neighbour_faces
from garment_jax.simulation.screening import Screen, ScreenLimits, faults, screen_clip
from garment_jax.simulation.settings import ClothSettings
from garment_jax.structs import Motion, Scene


class Job(NamedTuple):
    """One clip to simulate."""

    name: str
    split: str  # "train" or "test": the folder it goes to
    motion: Motion


class Outcome(NamedTuple):
    """What became of a clip."""

    job: str
    path: Path | None  # None when it was left out
    seconds: float  # 0 for one that was there already
    screen: Screen | None
    faults: list[str]  # why it was left out, in words


def simulate_clips(
    scene: Scene,
    jobs: Sequence[Job],
    out: Path,
    settings: ClothSettings,
    *,
    flat: np.ndarray | None = None,
    workers: int = 1,
    limits: ScreenLimits = ScreenLimits(),
    progress: Callable[[str], None] = print,
) -> list[Outcome]:
    """Simulate `jobs` into `out/SPLIT/NAME.h5`; return their outcomes in the jobs' order.

    A clip that is there already, of the same content, is kept: an interrupted call goes on where it was.
    The drape from rest is computed once. `flat` `[u, 2]` is the flat pattern in metres. A
    clip that fails the screening is named, with the reason, and no file is left.
    """
    if scene.collider is not None:
        neighbour_faces(scene.collider.faces)  # an open one has no inside: penetration would go unseen
    keys = [content_key(scene, job.motion, settings, flat) for job in jobs]
    paths = [out / job.split / f"{job.name}.h5" for job in jobs]
    todo = [i for i in range(len(jobs)) if stored_hash(paths[i]) != keys[i]]
    outcomes: dict[int, Outcome] = {
        i: Outcome(jobs[i].name, paths[i], 0.0, None, []) for i in range(len(jobs)) if i not in todo
    }
    if len(todo) < len(jobs):
        progress(f"{len(jobs) - len(todo)} of {len(jobs)} clips are there already")
    if not todo:
        return [outcomes[i] for i in range(len(jobs))]
    from garment_jax.simulation.newton_cloth import drape

    progress("draping the garment from rest")
    draped = drape(scene, settings, flat=flat)
    tasks = {
        i: (scene, jobs[i], paths[i], settings, draped, flat, limits, keys[i])
        for i in sorted(todo, key=lambda i: -len(jobs[i].motion.root))  # the longest first: no core waits
    }
    began, done, total = time.perf_counter(), 0, sum(len(jobs[i].motion.root) for i in todo)
    for i, outcome in _run(tasks, workers):
        outcomes[i] = outcome
        done += len(jobs[i].motion.root)
        seconds = time.perf_counter() - began
        verdict = "left out: " + "; ".join(outcome.faults) if outcome.faults else "kept"
        progress(
            f"{outcome.job}: {len(jobs[i].motion.root)} frames in {outcome.seconds:.0f} s, {verdict}; "
            f"{done}/{total} frames, {seconds / done * (total - done):.0f} s left"
        )
    return [outcomes[i] for i in range(len(jobs))]


def content_key(scene: Scene, motion: Motion, settings: ClothSettings, flat: np.ndarray | None) -> str:
    """Return 16 hexadecimal digits of all that a simulated clip depends on."""
    digest = hashlib.sha256(scene_hash(scene).encode())
    digest.update(json.dumps([asdict(settings), motion.fps], sort_keys=True).encode())
    carried = [array for part in (scene.collider, scene.pins) if part is not None for array in part]
    for array in (motion.rotations, motion.root, flat, *carried):
        digest.update(b"" if array is None else np.ascontiguousarray(array, "<f4").tobytes())
    return digest.hexdigest()[:16]


def _run(tasks: dict[int, tuple], workers: int) -> Iterator[tuple[int, Outcome]]:
    if workers == 1:
        for i, task in tasks.items():
            yield i, _simulate_one(*task)
        return
    # spawned, not forked: JAX and Warp hold threads
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        running: dict[Future, int] = {pool.submit(_simulate_one, *task): i for i, task in tasks.items()}
        try:
            while running:
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    yield running.pop(future), future.result()
        except BaseException:
            for future in running:
                future.cancel()
            raise


def _simulate_one(
    scene: Scene,
    job: Job,
    path: Path,
    settings: ClothSettings,
    draped,
    flat: np.ndarray | None,
    limits: ScreenLimits,
    key: str,
) -> Outcome:
    from garment_jax.simulation.newton_cloth import simulate_frames

    began = time.perf_counter()
    frames = simulate_frames(scene, job.motion, settings, drape=draped, flat=flat)
    V = np.stack([np.asarray(frame, np.float32) for frame in frames])
    seconds = time.perf_counter() - began
    try:
        screen = screen_clip(scene, job.motion, V)
    except ValueError as error:
        return Outcome(job.name, None, seconds, None, [str(error)])
    wrong = faults(screen, limits)
    if wrong:
        return Outcome(job.name, None, seconds, screen, wrong)
    attributes = {
        "name": job.name,
        "split": job.split,
        "kind": "simulated",
        "engine": "newton SolverStyle3D",
        "settings": settings.describe(),
        "content_hash": key,
        "screen": json.dumps(screen._asdict()),
        "simulated_on": platform.machine(),
    }
    with SequenceWriter(path, scene, job.motion, attributes=attributes) as writer:
        writer.append(V)
    return Outcome(job.name, path, seconds, screen, [])
