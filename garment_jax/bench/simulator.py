"""A SIMULATE job: what a frame costs the simulator that made the truth."""

import time
from dataclasses import replace

import numpy as np

from garment_jax.bench.files import write_json
from garment_jax.bench.plan import Job, Plan
from garment_jax.bench.timing import first_frames
from garment_jax.io.sequence import open_sequence
from garment_jax.machine import machine, peak_mb


def time_simulator(plan: Plan, job: Job) -> None:
    """Simulate the first frames of the first test clip; milliseconds between frames after the first.

    Building the model, the drape and what goes before a clip's first frame do not count. Without the
    engine the job is refused, and the report leaves the figure open.
    """
    from garment_jax.simulation.newton_cloth import drape, simulate_frames
    from garment_jax.simulation.settings import ClothSettings

    settings = ClothSettings(blend=2, hold=2)
    with open_sequence(plan.test[0]) as clip:
        scene, motion, name = clip.scene, first_frames(clip.motion, plan.settings.simulator_frames), clip.name
    draped = drape(scene, replace(settings, settle=2), flat=None)
    times = [time.perf_counter()]
    for _ in simulate_frames(scene, motion, settings, drape=draped, flat=None):
        times.append(time.perf_counter())
    later = 1e3 * np.diff(times)[1:]
    record = {
        "clip": name,
        "frames": len(later),
        "self_collision": settings.self_collision,
        "ms_per_frame": float(np.median(later)),
        "ms_per_frame_p95": float(np.percentile(later, 95)),
        "peak_mb": peak_mb(),
        "machine": machine(),
    }
    write_json(job.done, record)
