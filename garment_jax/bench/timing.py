"""A TIME job: what a row costs to run, in a process of its own."""

import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np

from garment_jax.baselines import Runner
from garment_jax.bench.files import write_json
from garment_jax.bench.methods import load, stored_bytes
from garment_jax.bench.plan import Job, Plan
from garment_jax.io.sequence import open_sequence
from garment_jax.machine import machine, peak_mb, process_age
from garment_jax.structs import Motion, Scene

WARM_UP = 20  # single steps that are not counted


def time_row(plan: Plan, job: Job) -> None:
    """Measure the row on one test clip and write the result; nothing else should run meanwhile."""
    imported = process_age()
    jax.config.update("jax_enable_compilation_cache", False)  # what a first run costs is to be told
    row, timing = plan.loaded.row(job.row), plan.settings.timing
    began = time.perf_counter()
    runner = load(row, plan.run_dir(job.run), plan.config(row, job.seed))
    loaded = time.perf_counter() - began
    with open_sequence(_timed_clip(plan)) as clip:
        scene, motion, name = clip.scene, first_frames(clip.motion, timing.frames), clip.name
    record: dict[str, Any] = {"row": row.name, "run": job.run, "seed": job.seed, "clip": name}
    record |= {"start_up_s": None if imported is None else imported + loaded}
    record |= time_chunks(runner, scene, motion, name)
    record |= time_steps(runner, scene, motion, name, steps=timing.steps)
    record |= {"parameters": runner.parameters, "peak_mb": peak_mb()}
    record |= time_batch(runner, scene, motion, name, batch=timing.batch)
    with tempfile.TemporaryDirectory() as folder:
        record["bytes"] = stored_bytes(row, plan.run_dir(job.run), Path(folder))
    write_json(job.done, record | {"machine": machine()})


def _timed_clip(plan: Plan) -> Path:
    """Return the test clip to time on: the one named, or the longest."""
    named = [path for path in plan.test if path.stem == plan.settings.timing.clip]
    if plan.settings.timing.clip and not named:
        known = ", ".join(path.stem for path in plan.test)
        raise ValueError(f"[timing] clip {plan.settings.timing.clip!r} is no test clip; choose of {known}.")
    return named[0] if named else max(plan.test, key=_frames)


def _frames(path: Path) -> int:
    with open_sequence(path) as clip:
        return clip.frames


def first_frames(motion: Motion, frames: int) -> Motion:
    """Return the first `frames` frames of a motion, or all it has."""
    return Motion(motion.rotations[:frames], motion.root[:frames], motion.fps)


def time_chunks(runner: Runner, scene: Scene, motion: Motion, name: str) -> dict[str, Any]:
    """Return milliseconds a frame over whole chunks: median and 95th percentile after the first.

    Everything counts from motion to garment in the world: networks, pins, collision handling. What the
    first chunk took beyond a usual one is the time to prepare and compile.
    """
    assert runner.animate is not None
    times, began = [], time.perf_counter()
    for chunk in runner.animate(scene, motion, name):
        np.asarray(chunk.V)  # waits for the device
        times.append((time.perf_counter() - began, len(chunk.V)))
        began = time.perf_counter()
    usual = max(k for _, k in times)
    later = np.array([t / k for t, k in times[1:] if k == usual] or [t / k for t, k in times])
    return {
        "ms_per_frame": 1e3 * float(np.median(later)),
        "ms_per_frame_p95": 1e3 * float(np.percentile(later, 95)),
        "chunk": usual,
        "chunks": len(later),
        "compile_s": max(times[0][0] - usual * float(np.median(later)), 0.0),
    }


def time_steps(runner: Runner, scene: Scene, motion: Motion, name: str, *, steps: int) -> dict[str, Any]:
    """Return milliseconds of one compiled step, one frame in and out, waited for each time.

    The networks alone: without pins and collision handling. None for a method without a stream.
    """
    if runner.stream is None or not steps:
        return {"step_ms": None, "step_ms_p95": None}
    stream = runner.stream(scene, motion, name)
    state, times = stream.state, []
    for t in range(steps + WARM_UP):
        x = stream.frame(t % len(motion.root))
        began = time.perf_counter()
        state, V = stream.step(state, x)
        jax.block_until_ready((state, V))
        times.append(time.perf_counter() - began)
    later = 1e3 * np.array(times[WARM_UP:])
    return {"step_ms": float(np.median(later)), "step_ms_p95": float(np.percentile(later, 95))}


def time_batch(runner: Runner, scene: Scene, motion: Motion, name: str, *, batch: int) -> dict[str, Any]:
    """Return frames a second of `batch` motions side by side, without collision handling.

    A call compiles anew, so the figure is the difference between a long and a short one.
    """
    long = len(motion.root)
    short = max(long // 4, 1)
    if runner.rollout_batch is None or batch < 1 or short == long:
        return {"batch": None, "batch_frames_per_s": None}
    seconds = {}
    for frames in (short, long, short, long):
        began = time.perf_counter()
        runner.rollout_batch(scene, [first_frames(motion, frames)] * batch, name)
        seconds[frames] = time.perf_counter() - began  # the second pair: files and code are in memory
    more = seconds[long] - seconds[short]
    return {"batch": batch, "batch_frames_per_s": batch * (long - short) / more if more > 0 else None}
