"""One job in a process of its own: `python -m garment_jax.bench.worker`, told what by the runner.

Memory is then given back after each job, its peak is the job's own, and a stopped job leaves the others.
"""

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

from garment_jax.baselines import METHODS
from garment_jax.bench.plan import LATENT, ROLL, SIMULATE, TIME, TRAIN, Job, Plan
from garment_jax.bench.quick import quick_version
from garment_jax.bench.settings import check_methods, load_benchmark

WORKER = (sys.executable, "-m", "garment_jax.bench.worker")


def make_plan(told: dict[str, Any]) -> Plan:
    """Return the plan that the runner works through: from {benchmark, data, out, quick, only, again}."""
    loaded = load_benchmark(told["benchmark"])
    if told["quick"]:
        loaded = quick_version(loaded)
    check_methods(loaded.settings, METHODS, told["benchmark"])
    again = Path(told["again"]) if told.get("again") else None
    return Plan(loaded, Path(told["data"]), Path(told["out"]), only=told.get("only", ()), again=again)


def told_job(job: Job) -> dict[str, Any]:
    """Return a job as JSON; `job_told` is the inverse."""
    return job._asdict() | {"done": str(job.done)}


def job_told(told: dict[str, Any]) -> Job:
    values: dict[str, Any] = told | {"done": Path(told["done"])}
    return Job(**values)


def work(plan: Plan, job: Job) -> None:
    """Do one job to its end."""
    if job.kind == TRAIN:
        from garment_jax.bench.training import train_run

        train_run(plan, job)
    elif job.kind == ROLL:
        from garment_jax.bench.measuring import measure_row

        measure_row(plan, job)
    elif job.kind == TIME:
        from garment_jax.bench.timing import time_row

        time_row(plan, job)
    elif job.kind == LATENT:
        from garment_jax.bench.latent import measure_latent

        measure_latent(plan, job)
    elif job.kind == SIMULATE:
        from garment_jax.bench.simulator import time_simulator

        time_simulator(plan, job)


def work_there(told: dict[str, Any], job: Job) -> float:
    """Do a job in a process of its own, on whatever machine; return the seconds it took."""
    began = time.monotonic()
    words = [*WORKER, json.dumps(told | {"job": told_job(job), "farmed": True})]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:] or ["no word of it"]
        raise ValueError(f"{last[0].removeprefix('error: ')} (exit code {done.returncode})")
    return time.monotonic() - began


def _end_with_parent(parent: int) -> None:
    """End when the worker that started this ends: its job is done again elsewhere."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def main() -> int:
    """Read what to do from the first argument, do it; a refusal is one sentence and exit code 2."""
    told = json.loads(sys.argv[1])
    if told.get("farmed"):
        threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    try:
        work(make_plan(told), job_told(told["job"]))
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
