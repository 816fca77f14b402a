"""`garment-jax benchmark`: works through the plan, one process after the other, and writes the report."""

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Container, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from garment_jax.bench.files import read_json
from garment_jax.bench.keeping import keep, take_over
from garment_jax.bench.plan import SIMULATE, TIME, TRAIN, Job, Plan
from garment_jax.bench.records import read_again
from garment_jax.bench.report import write_report
from garment_jax.bench.settings import load_benchmark
from garment_jax.bench.worker import WORKER, make_plan, told_job, work_there
from garment_jax.farm.work import Farm, Work
from garment_jax.storage.lock import locked


class StoppedError(SystemExit):
    """Ctrl-C or SIGTERM: what is done is kept; as SystemExit it ends the process with code 130."""


def benchmark(
    path: str | Path,
    *,
    data: str | Path | None = None,
    out: str | Path | None = None,
    again: str | Path | None = None,
    quick: bool = False,
    only: Sequence[str] = (),
    report_only: bool = False,
    timed_by: str = "",
    kept: str | Path | None = None,
    farm: Farm | None = None,
    show: Callable[[str], object] = print,
) -> int:
    """Do what is missing of the benchmark `path` and write its report; return how many jobs failed.

    `data`, `out` and `again`, a folder of the test clips' second simulations, default to the file's.
    `timed_by` is a command line that runs the measurements of run time, such as `taskset -c 0,1`. Records of
    finished jobs are taken over from the folder `kept` and written there. With a `farm` of several workers
    they train and measure errors at once; run time is measured here, one job after the other, when they are
    done. Raises `ValueError` or `OSError` in one sentence, and `StoppedError` (exit code 130) where it is
    stopped: the same command goes on.
    """
    told = _told(path, data, out, again, quick=quick, only=only)
    at_once = None if farm is None or farm.here(2) else farm
    if at_once:  # workers may be in folders of their own
        told |= {name: _placed(told[name]) for name in ("benchmark", "data", "out", "again") if told[name]}
    plan = make_plan(told)
    read_again(plan)  # what is damaged is refused now, not after hours
    with locked(plan.out, "running a benchmark", remedy="name another --out"):
        if kept is not None:
            show(f"{len(take_over(plan, Path(kept)))} records taken over from {kept}")
        failed: dict[Path, str] = {}
        if at_once and not report_only:
            for done in _do_ready(plan, told, at_once, failed, show):
                if kept is not None and done:
                    keep(plan, Path(kept))
        while not report_only:
            job = next_job(plan, failed)
            if job is None:
                break
            began = time.monotonic()
            show(f"{describe(job)} ...")
            code = run_job(told, job, timed_by=timed_by if job.kind in (TIME, SIMULATE) else "")
            if code or not job.done.is_file():
                failed[job.done] = f"{describe(job)} failed (exit code {code})"
                show(failed[job.done])
            else:
                show(f"{describe(job)} took {time.monotonic() - began:.0f} s")
                if kept is not None:
                    keep(plan, Path(kept))
        if kept is not None:
            keep(plan, Path(kept))
        for written in write_report(plan, told):
            show(str(written))
    return len(failed)


def _told(path: Any, data: Any, out: Any, again: Any, *, quick: bool, only: Sequence[str]) -> dict[str, Any]:
    loaded = load_benchmark(path)
    folder = Path(out or loaded.settings.out)
    return {
        "benchmark": str(path),
        "data": str(data or loaded.settings.data or loaded.base.data.dir),
        "out": str(folder / "quick" if quick else folder),
        "again": str(again or loaded.settings.again),
        "quick": quick,
        "only": list(only),
    }


def next_job(plan: Plan, failed: dict[Path, str]) -> Job | None:
    """Return the first job that is neither done nor failed nor in vain, None at the end."""
    for job in plan.jobs():
        if job.done.is_file() or job.done in failed:
            continue
        if job.kind not in (TRAIN, SIMULATE) and not _trained(plan, job):
            continue  # its training failed or diverged
        return job
    return None


def _placed(text: str) -> str:
    return str(Path(text).absolute()) if Path(text).exists() or os.sep in text else text  # else a name


def ready_jobs(plan: Plan, failed: Container[Path]) -> dict[Path, Job]:
    """Return the jobs that any worker may do now: none whose run is not trained, or whose rate is searched.

    Times are measured where nothing else runs.
    """
    methods = {row.method for row in plan.settings.rows} & set(plan.settings.search.methods)
    searches = {method: plan.search_jobs(method) for method in methods}
    searched = {job.done for jobs in searches.values() for job in jobs}
    searching = {m for m in methods if any(_is_open(job, failed) for job in searches[m])}
    ready: dict[Path, Job] = {}
    for job in plan.jobs():
        if job.kind in (TIME, SIMULATE) or not _is_open(job, failed):
            continue
        if job.kind != TRAIN and not _trained(plan, job):
            continue
        if job.done in searched or plan.loaded.row(job.row).method not in searching:
            ready.setdefault(job.done, job)
    return ready


def _is_open(job: Job, failed: Container[Path]) -> bool:
    return not job.done.is_file() and job.done not in failed


def _do_ready(
    plan: Plan, told: dict[str, Any], farm: Farm, failed: dict[Path, str], show: Callable[[str], object]
) -> Iterator[bool]:
    """Do what is ready until nothing more is; yield whether a job was done, after each."""
    while jobs := ready_jobs(plan, failed):
        show(f"{len(jobs)} jobs for {farm.workers} workers ...")
        for key, outcome in farm.map(Work(partial(dict, told), work_there), jobs):
            error = outcome.error or ("" if key.is_file() else f"{key} is not there")
            if error:
                failed[key] = f"{describe(jobs[key])} failed: {error}"
            show(failed[key] if error else f"{describe(jobs[key])} took {outcome.value:.0f} s")
            yield not error


def _trained(plan: Plan, job: Job) -> bool:
    record = plan.run_dir(job.run) / "trained.json"
    return record.is_file() and not read_json(record)["diverged"]


def describe(job: Job) -> str:
    """Return a job in words, with the time."""
    scale = "" if job.rate == 1 else f", rates × {job.rate:g}"
    scale += "" if job.length == 1 else f", length × {job.length:g}"
    who = f"{job.row} seed {job.seed}{scale} ({job.run})" if job.row else ""
    return f"{time.strftime('%H:%M:%S')} {job.kind} {who}".rstrip()


def run_job(told: dict[str, Any], job: Job, *, timed_by: str = "") -> int:
    """Run one job in its own process and return its exit code; a signal is passed on once, then raised.

    The terminal's Ctrl-C reaches the child by itself, unless it is in a session of its own (`timed_by`):
    passing it on as well would make two, and the second one ends a training without saving.
    """
    words = [*shlex.split(timed_by), *WORKER, json.dumps(told | {"job": told_job(job)})]
    got: list[int] = []

    def note(number: int, _frame: Any) -> None:
        got.append(number)
        reached = number == signal.SIGINT and not timed_by and _in_foreground()
        if child is not None and not reached:
            child.send_signal(number)

    child: subprocess.Popen | None = None
    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        # a command that stops its caller's process group meanwhile must not stop the measurement itself
        child = subprocess.Popen(words, start_new_session=bool(timed_by))
        code = child.wait()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if got or code == 130:
        print("benchmark: stopped; the same command goes on", file=sys.stderr)
        raise StoppedError(130)
    return code


def _in_foreground() -> bool:
    try:
        return os.isatty(0) and os.tcgetpgrp(0) == os.getpgrp()
    except OSError:
        return False
