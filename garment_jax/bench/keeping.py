"""Records of finished jobs in a folder of their own, small enough to be committed or carried elsewhere.

A benchmark takes hours and its runs take gigabytes. With `--keep DIR` what has been measured outlives both:
it is taken over where data, configuration and rows are the same (the names say so); nothing is done twice.
Rollouts and latent shapes stay behind, and the pictures of them.
"""

import json
from pathlib import Path

from garment_jax.bench.files import read_json, write_json
from garment_jax.bench.plan import SIMULATE, TRAIN, Job, Plan, known_training
from garment_jax.storage.whole import write_text


def take_over(plan: Plan, kept: Path) -> list[str]:
    """Put the records of `kept` where the plan looks for them; return the names of those it lacked.

    A run comes without its parameters, so its training counts as done only where nothing is left to be made
    with it; else it is trained anew, and until then the report reads what is known of it. Searches first: the
    rates that win name the runs that follow. Raises `ValueError` where `kept` is no folder: now, not when the
    first job has ended.
    """
    if kept.exists() and not kept.is_dir():
        raise ValueError(f"--keep {kept} is a file; name a folder for the records.")
    taken: list[str] = []
    for method in plan.settings.search.methods:
        taken += _take(plan.search_jobs(method), kept)
    # a run's other records may belong to rows that `plan.only` leaves out
    jobs = list(Plan(plan.loaded, plan.data, plan.out).jobs())
    taken += _take([job for job in jobs if job.kind != TRAIN], kept)
    needed = {job.run for job in jobs if job.kind not in (TRAIN, SIMULATE) and not job.done.is_file()}
    diverged = [job for job in jobs if job.kind == TRAIN and _diverged(_name(job, kept))]
    whole = [job for job in jobs if job.kind == TRAIN and job.run not in needed]
    taken += _take([*whole, *diverged], kept)
    for job in jobs:
        if job.kind == TRAIN and not job.done.is_file() and _name(job, kept).is_file():
            write_json(known_training(job), read_json(_name(job, kept)))
    return taken


def keep(plan: Plan, kept: Path) -> None:
    """Write every finished job's record into `kept`, those that are new or have changed."""
    searched = [job for method in plan.settings.search.methods for job in plan.search_jobs(method)]
    for job in [*searched, *Plan(plan.loaded, plan.data, plan.out).jobs()]:
        if not job.done.is_file():
            continue
        text = json.dumps(read_json(job.done), separators=(",", ":"), ensure_ascii=False) + "\n"
        path = _name(job, kept)
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_text(path, text)


def _name(job: Job, kept: Path) -> Path:
    """Return a job's file in `kept`: a run's by the run, the others' by what was measured."""
    return kept / (f"{job.run}.json" if job.kind == TRAIN else job.done.name)


def _diverged(path: Path) -> bool:
    return path.is_file() and bool(read_json(path).get("diverged"))


def _take(jobs: list[Job], kept: Path) -> list[str]:
    taken = []
    for job in jobs:
        path = _name(job, kept)
        if job.done.is_file() or not path.is_file():
            continue
        write_json(job.done, read_json(path))
        taken.append(path.stem)
    return taken
