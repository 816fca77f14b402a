"""A benchmark of six rows on five tiny clips, and results made up for it."""

import functools
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from garment_jax.bench.files import write_json
from garment_jax.bench.measuring import clip_record
from garment_jax.bench.plan import Job, Plan
from garment_jax.bench.settings import Row, load_benchmark
from garment_jax.bench.tables import ERRORS
from garment_jax.config import to_toml
from garment_jax.io.sequence import SequenceWriter, open_sequence
from tests.animation.tiny_model import CONFIG
from tests.reference.scene import make_motion, make_scene, write_clip

SCENE = make_scene(4, 16)
_FACTS = ("processor", "cores", "device", "python", "garment-jax", "jax", "flax", "numpy")
MACHINE = dict.fromkeys(_FACTS, "1") | {"date": "2026-11-22T02:00+00:00"}
TEXT = """
base = "tiny.toml"
data = "DATA"
out = "OUT"
order = ["main", "search", "seeds", "fractions"]
lengths = [5, 12]
every = 6
[budget.motion]
steps = 6
[search]
methods = ["ours"]
factors = [0.5, 1.0]
[[row]]
name = "ours"
title = "ours & all"
group = "main"
seeds = [0, 7]
[[row]]
name = "no_previous_state"
title = "without previous state"
group = "main"
set.motion.previous_state = false
[[row]]
name = "no_collision"
title = "without collisions"
group = "main"
collision = false
[[row]]
name = "skinned_template"
title = "skinned"
group = "main"
method = "skinned_template"
[[row]]
name = "auto_encoder"
title = "the truth encoded"
group = "main"
task = "reconstruction"
[[row]]
name = "ours_half"
title = "half of the clips"
group = "fractions"
part = 0.5
"""


@functools.cache
def clip_files() -> dict[str, bytes]:
    """Return the clips as SPLIT/NAME.h5 -> bytes, made once a process."""
    files = {}
    with tempfile.TemporaryDirectory() as folder:
        for split, name, count, frames in (("train", "waltz", 3, 6), ("test", "tango", 2, 12)):
            for k in range(1, count + 1):
                motion = make_motion(SCENE, frames if k == 1 else frames - 2, seed=k)
                path = write_clip(Path(folder) / f"{name}_{k}.h5", scene=SCENE, motion=motion)
                files[f"{split}/{path.name}"] = path.read_bytes()
    return files


def write_benchmark(folder: Path, text: str = TEXT) -> Path:
    """Write the benchmark, its experiment and clips (three to learn from, two to judge by)."""
    for name, held in clip_files().items():
        path = folder / "data" / name
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(held)
    (folder / "tiny.toml").write_text(to_toml(CONFIG))
    path = folder / "benchmark.toml"
    path.write_text(text.replace("DATA", str(folder / "data")).replace("OUT", str(folder / "out")))
    return path


def make_plan(folder: Path, text: str = TEXT, **options: Any) -> Plan:
    loaded = load_benchmark(write_benchmark(folder, text))
    return Plan(loaded, folder / "data", folder / "out", **options)


def finish(plan: Plan, job: Job, **values: Any) -> None:
    """Write a job's file as if it had been done, with figures made up; `values` are laid over it."""
    record = {"run": job.run, "seed": job.seed, "rate": job.rate, "length": job.length, "machine": MACHINE}
    write_json(job.done, record | _MADE[job.kind](plan, job) | values)


def _trained(plan: Plan, job: Job) -> dict[str, Any]:
    curve = [{"stage": "motion", "seconds": s, "rmse_cm": 9.0 / s} for s in (1.0, 2.0)]
    stages = {"stage_seconds": {"generative": 1.5, "motion": 2.0}, "wall_seconds": 4.0, "curve": curve}
    return stages | {"validation_cm": 4.5 * job.rate, "diverged": None, "clips": ["waltz_1"]}


def _rolled(plan: Plan, job: Job) -> dict[str, Any]:
    """Return figures that grow with the row's place in the file and with the seed."""
    row = plan.loaded.row(job.row)
    error = 1.0 + plan.settings.rows.index(row) + 0.1 * job.seed
    metrics = dict.fromkeys((metric for _, metric, _ in ERRORS), error) | {"rmse_cm": error}
    clips = {}
    for k, truth in enumerate(plan.test):
        frames = (12, 10)[k]
        found = {"frames": frames, "metrics": metrics, "per_frame": {"rmse_cm": [error + k] * frames}}
        clips[truth.stem] = clip_record(found, plan.settings.lengths)
    settings = {"every": 6, "sted_window_frames": 15, "sted_c": 0.1, "penetration_tolerance_mm": 0.1}
    task = "reconstruction" if row.task == "reconstruction" else "rollout"
    facts = {"row": job.row, "task": task, "rollouts": str(plan.rollouts(job).relative_to(plan.out))}
    return facts | {"parameters": 7, "settings": settings, "clips": clips, "mean": metrics}


def write_rollouts(plan: Plan, job: Job) -> None:
    """Write predictions that are off by noise of a centimetre."""
    folder = plan.rollouts(job)
    folder.mkdir(parents=True, exist_ok=True)
    for truth in plan.test:
        with open_sequence(truth) as clip:
            V = clip.read(0, clip.frames)
            V = V + np.random.default_rng(0).normal(0, 0.01, V.shape).astype(np.float32)
            with SequenceWriter(folder / truth.name, clip.scene, clip.motion, encoding="float32") as writer:
                writer.append(V)


def _timed(plan: Plan, job: Job) -> dict[str, Any]:
    place = [row.name for row in plan.settings.rows].index(job.row)
    names = ("ms_per_frame", "ms_per_frame_p95", "step_ms", "step_ms_p95", "start_up_s", "compile_s")
    return {name: 1.0 + place for name in names} | {
        "batch": 8,
        "batch_frames_per_s": 900.0,
        "peak_mb": 300.0,
        "parameters": 7,
        "bytes": 2e6,
    }


def _latent(plan: Plan, job: Job) -> dict[str, Any]:
    T = SCENE.garment.template - SCENE.body.joints[0]
    shapes = T + np.linspace(0, 0.1, 4)[None, :, None, None] * np.ones((2, 1, len(T), 3))
    job.done.parent.mkdir(parents=True, exist_ok=True)
    np.savez(job.done.with_suffix(".npz"), shapes=shapes)
    return {"pairs": 2, "steps": 4, "step_mm": 5.0, "bend_mm": 0.5, "ratio": 0.1, "ratio_worst": 0.2}


def _simulated(plan: Plan, job: Job) -> dict[str, Any]:
    return {"ms_per_frame": 170.0, "ms_per_frame_p95": 180.0}


_MADE = {"train": _trained, "roll": _rolled, "time": _timed, "latent": _latent, "simulate": _simulated}


def row_of(plan: Plan, name: str) -> Row:
    return plan.loaded.row(name)
