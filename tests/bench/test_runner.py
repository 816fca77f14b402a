"""Job after job in processes of their own: order, stop, resume, failure."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from garment_jax.bench import runner, worker
from garment_jax.bench.plan import Job, Plan
from garment_jax.bench.worker import job_told, make_plan, told_job
from garment_jax.farm.work import Outcome, Work
from tests.bench.made import TEXT, finish, write_benchmark

QUIET = {"show": lambda text: None}


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, list[Job]]:
    """A benchmark whose jobs are done at once and counted, and whose report is left out."""
    path, done = write_benchmark(tmp_path), []

    def at_once(told: dict, job: Job, *, timed_by: str = "") -> int:
        finish(make_plan(told), job)
        done.append(job)
        return 0

    monkeypatch.setattr(runner, "run_job", at_once)
    monkeypatch.setattr("garment_jax.bench.runner.write_report", lambda plan, told: [])
    return path, done


def test_everything_is_done_once(bench: tuple[Path, list[Job]]) -> None:
    path, done = bench
    assert runner.benchmark(path, **QUIET) == 0
    count = len(done)
    assert count > 15
    assert runner.benchmark(path, **QUIET) == 0
    assert len(done) == count


def test_stopped_anywhere_the_same_command_goes_on(
    bench: tuple[Path, list[Job]], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, done = bench
    at_once = runner.run_job

    def stopped(told: dict, job: Job, *, timed_by: str = "") -> int:
        if len(done) % 4 == 3:
            finish(make_plan(told), job)
            done.append(job)
            raise runner.StoppedError(130)
        return at_once(told, job, timed_by=timed_by)

    monkeypatch.setattr(runner, "run_job", stopped)
    stops = 0
    while stops < 20:
        try:
            runner.benchmark(path, **QUIET)
            break
        except runner.StoppedError:
            stops += 1
    assert 3 < stops < 20
    assert len({job.done for job in done}) == len(done)


def test_a_failed_job_is_told_and_the_others_are_done(
    bench: tuple[Path, list[Job]], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, done = bench
    at_once, said = runner.run_job, []
    monkeypatch.setattr(
        runner,
        "run_job",
        lambda told, job, timed_by="": 2 if job.row == "skinned_template" else at_once(told, job),
    )
    assert runner.benchmark(path, show=said.append) == 1
    assert any("train skinned_template" in line and "failed (exit code 2)" in line for line in said)
    assert {job.row for job in done} >= {"ours", "ours_half"}


def test_report_only_does_no_job(bench: tuple[Path, list[Job]]) -> None:
    path, done = bench
    assert runner.benchmark(path, report_only=True, **QUIET) == 0
    assert done == []


def test_quick_has_a_folder_of_its_own(bench: tuple[Path, list[Job]], tmp_path: Path) -> None:
    path, done = bench
    runner.benchmark(path, quick=True, **QUIET)
    assert all(job.done.is_relative_to(tmp_path / "out" / "quick") for job in done)


def job(tmp_path: Path) -> Job:
    return Job("train", "ours", 0, 1.0, 1.0, "ours-1", tmp_path / "done.json")


def test_a_job_survives_json(tmp_path: Path) -> None:
    assert job_told(json.loads(json.dumps(told_job(job(tmp_path))))) == job(tmp_path)


def test_the_exit_code_is_the_childs_and_130_stops(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for code, program in ((0, "pass"), (2, "raise SystemExit(2)")):
        monkeypatch.setattr(runner, "WORKER", (sys.executable, "-c", program))
        assert runner.run_job({}, job(tmp_path)) == code
    monkeypatch.setattr(runner, "WORKER", (sys.executable, "-c", "raise SystemExit(130)"))
    with pytest.raises(runner.StoppedError):
        runner.run_job({}, job(tmp_path))


def test_a_command_may_run_the_measurement(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = "import os, sys; sys.exit(7 if os.environ.get('MEASURED') == '1' else 0)"
    monkeypatch.setattr(runner, "WORKER", (sys.executable, "-c", program))
    assert runner.run_job({}, job(tmp_path), timed_by="env MEASURED=1") == 7


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_is_passed_to_a_child_in_a_session_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = (
        f"import os, signal, sys, time\nos.kill({os.getpid()}, signal.SIGINT)\n"
        "try: time.sleep(60)\nexcept KeyboardInterrupt: sys.exit(130)\n"
    )
    monkeypatch.setattr(runner, "WORKER", (sys.executable, "-c", program))
    monkeypatch.setattr(runner, "_in_foreground", lambda: True)  # whose Ctrl-C does not reach that session
    began = time.monotonic()
    with pytest.raises(runner.StoppedError):
        runner.run_job({}, job(tmp_path), timed_by="env")
    assert time.monotonic() - began < 30


def test_a_signal_reaches_the_child_and_stops_the_benchmark(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard = tmp_path / "heard"
    program = (
        "import os, pathlib, signal, sys, time\n"
        f"signal.signal(signal.SIGTERM, lambda *_: (pathlib.Path({str(heard)!r}).touch(), sys.exit(130)))\n"
        f"os.kill({os.getpid()}, signal.SIGTERM)\n"
        "time.sleep(60)\n"
    )
    monkeypatch.setattr(runner, "WORKER", (sys.executable, "-c", program))
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(runner.StoppedError):
        runner.run_job({}, job(tmp_path))
    assert heard.exists()
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_worker_refuses_in_one_sentence(tmp_path: Path) -> None:
    path = write_benchmark(tmp_path, TEXT)
    told = {"benchmark": str(path), "data": str(tmp_path / "none"), "out": str(tmp_path), "quick": False}
    words = [*runner.WORKER, json.dumps(told | {"job": told_job(job(tmp_path))})]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert "Traceback" not in done.stderr


class AtOnce:
    """A farm whose jobs are done at once, in an order of its own; it notes what it was given together."""

    workers = 3

    def __init__(self, plan: Plan) -> None:
        self.plan, self.rounds = plan, []

    def __enter__(self) -> "AtOnce":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def here(self, jobs: int) -> bool:
        return False

    def map(self, work: Work, jobs: dict[Path, Job]) -> Iterator[tuple[Path, Outcome]]:
        self.rounds.append(list(jobs.values()))
        for key, job in reversed(jobs.items()):
            if job.row == "skinned_template":
                yield key, Outcome(None, "the disk is full.")
            else:
                finish(self.plan, job)
                yield key, Outcome(1.0)


def test_a_farm_does_what_is_ready_at_once_and_times_are_measured_after_it(
    bench: tuple[Path, list[Job]], tmp_path: Path
) -> None:
    path, done = bench
    told = runner._told(path, None, None, None, quick=False, only=())
    farm, said = AtOnce(make_plan(told)), []
    assert runner.benchmark(path, farm=farm, show=said.append) == 1
    assert any("train skinned_template" in line and "failed: the disk is full." in line for line in said)
    at_once = [job for jobs in farm.rounds for job in jobs]
    assert len({job.done for job in at_once}) == len(at_once)
    assert {job.kind for job in at_once} == {"train", "roll", "latent"}
    assert {job.kind for job in done} == {"time", "simulate"}
    trained: set[str] = set()
    for jobs in farm.rounds:
        assert all(job.kind == "train" or job.run in trained for job in jobs)
        trained |= {job.run for job in jobs if job.kind == "train"}
    rest = next(iter(make_plan(told).settings.search.methods))
    first = [job for job in farm.rounds[0] if make_plan(told).loaded.row(job.row).method == rest]
    assert {job.rate for job in first} == set(make_plan(told).settings.search.factors)  # the search alone


def test_a_farms_job_is_refused_with_the_last_words_of_its_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = "import sys; print('error: no room.', file=sys.stderr); sys.exit(2)"
    monkeypatch.setattr(worker, "WORKER", (sys.executable, "-c", program))
    with pytest.raises(ValueError, match=r"^no room\. \(exit code 2\)$"):
        worker.work_there({}, job(tmp_path))


def test_damaged_second_simulations_are_refused_before_any_job(bench: tuple[Path, list[Job]]) -> None:
    path, done = bench
    plan = make_plan(runner._told(path, None, None, None, quick=False, only=()))
    again = path.parent / "again"
    again.mkdir()
    for clip in plan.test:
        (again / clip.name).write_bytes(clip.read_bytes())
    cut = again / plan.test[-1].name
    cut.write_bytes(cut.read_bytes()[:2000])
    with pytest.raises(OSError, match="truncated"):
        runner.benchmark(path, again=again, **QUIET)
    assert done == []
    cut.write_bytes(plan.test[-1].read_bytes())
    assert runner.benchmark(path, again=again, **QUIET) == 0
