"""A ROLL job: a trained row on every test clip, and every metric of it."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from garment_jax.baselines import Runner
from garment_jax.bench.files import write_json
from garment_jax.bench.methods import load
from garment_jax.bench.plan import Job, Plan, is_reconstruction
from garment_jax.bench.settings import Row
from garment_jax.evaluation.command import evaluate_files
from garment_jax.io.sequence import SequenceWriter, open_sequence
from garment_jax.machine import machine
from garment_jax.storage.whole import replaced


def measure_row(plan: Plan, job: Job) -> None:
    """Roll the row out (or let it reconstruct) on every test clip, evaluate, write the result."""
    row = plan.loaded.row(job.row)
    runner = load(row, plan.run_dir(job.run), plan.config(row, job.seed))
    folder = plan.rollouts(job)
    shutil.rmtree(folder, ignore_errors=True)  # without a record: of a job that did not end
    clips = {}
    with replaced(folder) as (made,):
        for truth in plan.test:
            write_prediction(row, runner, truth, made / truth.name)
            found = evaluate_files(made / truth.name, truth, every=plan.settings.every, arms=False)
            clips[truth.stem] = clip_record(found, plan.settings.lengths)
    record = {
        "row": row.name,
        "run": job.run,
        "seed": job.seed,
        "rate": job.rate,
        "task": "reconstruction" if is_reconstruction(row) else "rollout",
        "rollouts": str(folder.relative_to(plan.out)),
        "parameters": runner.parameters,
        "settings": found["settings"],
        "clips": clips,
        "mean": mean_of([clip["metrics"] for clip in clips.values()]),
        "machine": machine(),
    }
    write_json(job.done, record)


def write_prediction(row: Row, runner: Runner, truth: Path, out: Path) -> None:
    """Write what the row makes of the clip `truth` as a sequence file, frames as float32."""
    with open_sequence(truth) as clip:
        scene, motion, name = clip.scene, clip.motion, clip.name
        attributes = {"kind": "predicted", "name": name}
        with SequenceWriter(out, scene, motion, encoding="float32", attributes=attributes) as writer:
            if is_reconstruction(row):
                if runner.reconstruct is None:
                    raise ValueError(
                        f"row {row.name}: method {row.method!r} reconstructs nothing; drop its task."
                    )
                writer.append(runner.reconstruct(scene, motion, clip.read(0, clip.frames), name))
                return
            if runner.animate is None:
                raise ValueError(f"row {row.name}: method {row.method!r} animates nothing; drop its task.")
            for chunk in runner.animate(scene, motion, name):
                writer.append(chunk.V)


def clip_record(found: dict[str, Any], lengths: tuple[int, ...]) -> dict[str, Any]:
    """Return what is kept of a clip's evaluation: its metrics, the error by frame and up to each length."""
    error = np.asarray(found["per_frame"]["rmse_cm"])
    return {
        "frames": found["frames"],
        "metrics": found["metrics"],
        "first": first_errors(error, lengths),
        "rmse_cm_per_frame": [round(float(e), 4) for e in error],
    }


def first_errors(error: np.ndarray, lengths: tuple[int, ...]) -> dict[str, float | None]:
    """Return the RMSE in cm over the first k frames for each k, None where the clip is shorter."""
    return {str(k): float(np.sqrt(np.square(error[:k]).mean())) if len(error) >= k else None for k in lengths}


def mean_of(metrics: list[dict[str, float | None]]) -> dict[str, float | None]:
    """Return the plain mean over clips; None where a clip has none."""
    means: dict[str, float | None] = {}
    for name in metrics[0]:
        values = [m.get(name) for m in metrics]
        means[name] = None if any(v is None for v in values) else float(np.mean(values))  # type: ignore[arg-type]
    return means
