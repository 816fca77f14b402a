"""A TRAIN job: one run, trained to its end, and what its log says."""

import resource
import time
from pathlib import Path
from typing import Any

from garment_jax.bench.files import read_json, write_json
from garment_jax.bench.methods import fit
from garment_jax.bench.plan import Job, Plan
from garment_jax.bench.sharing import share_prepared
from garment_jax.config import to_dict
from garment_jax.machine import machine
from garment_jax.training.log import read_log
from garment_jax.training.loop import DivergedError

SESSIONS = "sessions.json"  # seconds of every process that worked on a run


def train_run(plan: Plan, job: Job) -> None:
    """Train the job's run and write `trained.json`; a run that diverged says so there instead."""
    row = plan.loaded.row(job.row)
    config = plan.config(row, job.seed, rate=job.rate, length=job.length)
    folder = plan.run_dir(job.run)
    share_prepared(folder, folder.parent)
    diverged = ""
    began, cpu = time.monotonic(), _cpu_seconds()
    try:
        fit(row.method, config, folder, plan.data_dir(row.part), data=plan.data_hash(row.part))
    except DivergedError as error:
        diverged = str(error)
    finally:
        sessions = read_json(folder / SESSIONS) if (folder / SESSIONS).exists() else []
        sessions.append({"wall": time.monotonic() - began, "cpu": _cpu_seconds() - cpu})
        write_json(folder / SESSIONS, sessions)
    record = {
        "run": job.run,
        "method": row.method,
        "seed": job.seed,
        "rate": job.rate,
        "length": job.length * row.length,
        "part": row.part,
        "clips": [path.stem for path in plan.clips_of(row.part)],
        "data": plan.data_hash(row.part),
        "config": to_dict(config),
        "diverged": diverged or None,
        "cpu_seconds": sum(s["cpu"] for s in sessions),
        "wall_seconds": sum(s["wall"] for s in sessions),
        **log_figures(folder),
        "machine": machine(),
    }
    if diverged:
        record["validation_cm"] = None
    write_json(job.done, record)


def _cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def log_figures(folder: Path) -> dict[str, Any]:
    """Return what a run's log tells: seconds by stage, the validation's curve and its last error.

    Of a stage that was taken over from another run the seconds are those it took there. The column RNN's
    errors are of cells, the others' of vertices: the last error and the curve are the latents'.
    """
    entries = read_log(folder)
    stages = list(dict.fromkeys(entry["stage"] for entry in entries))
    seconds = {s: max(e["seconds"] for e in entries if e["stage"] == s) for s in stages}
    before = {s: sum(seconds[o] for o in stages[:i]) for i, s in enumerate(stages)}
    checks = [e for e in entries if e["kind"] == "validation" and e["stage"] != "column_rnn"]
    checks = [e for e in checks if e.get("rmse_cm") is not None]
    return {
        "stage_seconds": seconds,
        "curve": [
            {"stage": e["stage"], "seconds": before[e["stage"]] + e["seconds"], "rmse_cm": e["rmse_cm"]}
            for e in checks
        ],
        "validation_cm": checks[-1]["rmse_cm"] if checks else None,
    }
