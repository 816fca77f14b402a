"""Records that outlive their runs."""

import shutil
from pathlib import Path

import pytest

from garment_jax.bench import runner
from garment_jax.bench.files import read_json, write_json
from garment_jax.bench.keeping import keep, take_over
from garment_jax.bench.plan import TRAIN, Job, Plan
from garment_jax.bench.plots import all_plots
from garment_jax.bench.records import gather
from garment_jax.bench.worker import make_plan as told_plan
from tests.bench.made import finish, make_plan, write_benchmark


def _finish_all(plan: Plan) -> list[Job]:
    done = []
    while (job := runner.next_job(plan, {})) is not None:
        finish(plan, job)
        done.append(job)
    return done


def test_a_benchmark_on_another_machine_finds_nothing_left_to_do(tmp_path: Path) -> None:
    plan, kept = make_plan(tmp_path), tmp_path / "kept"
    done = _finish_all(plan)
    keep(plan, kept)
    shutil.rmtree(plan.out)
    again = make_plan(tmp_path)
    assert runner.next_job(again, {}) is not None
    taken = take_over(again, kept)
    assert 10 < len(taken) <= len(done)  # what came before the search had another rate
    assert runner.next_job(again, {}) is None
    assert all(read_json(job.done)["run"] == job.run for job in again.jobs())
    assert take_over(again, kept) == []


def test_a_run_with_something_left_to_measure_is_trained_anew(tmp_path: Path) -> None:
    plan, kept = make_plan(tmp_path), tmp_path / "kept"
    _finish_all(plan)
    keep(plan, kept)
    gone = plan.roll_job(plan.loaded.row("no_previous_state"), 0)  # at the rate that the search found
    shutil.rmtree(plan.out)
    again = make_plan(tmp_path)
    (kept / gone.done.name).unlink()
    take_over(again, kept)
    records = gather(again)
    whole = {record.row.name: record for record in records.rows}["no_previous_state"]
    assert whole.trained[0]["run"] == gone.run  # the report tells of it all the same
    assert all_plots(records, again.settings.lengths)
    left = []
    while (job := runner.next_job(again, {})) is not None:
        finish(again, job)
        left.append((job.kind, job.run))
    assert left == [(TRAIN, gone.run), (gone.kind, gone.run)]


def test_a_diverged_run_is_not_tried_again(tmp_path: Path) -> None:
    plan, kept = make_plan(tmp_path), tmp_path / "kept"
    lost = plan.train_job(plan.loaded.row("skinned_template"), 0)
    finish(plan, lost, diverged="loss is NaN at step 3", validation_cm=None)
    _finish_all(plan)
    keep(plan, kept)
    shutil.rmtree(plan.out)
    again = make_plan(tmp_path)
    take_over(again, kept)
    assert read_json(lost.done)["diverged"]
    assert runner.next_job(again, {}) is None


def test_the_command_keeps_every_job_as_it_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, kept, count = write_benchmark(tmp_path), tmp_path / "kept", []

    def at_once(told: dict, job: Job, *, timed_by: str = "") -> int:
        finish(told_plan(told), job)
        count.append(len(list(kept.glob("*.json"))))
        return 0

    monkeypatch.setattr(runner, "run_job", at_once)
    monkeypatch.setattr("garment_jax.bench.runner.write_report", lambda plan, told: [])
    said: list[str] = []
    assert runner.benchmark(path, kept=kept, show=said.append) == 0
    assert count == list(range(len(count)))
    assert said[0] == f"0 records taken over from {kept}"


def test_records_of_other_data_are_left_alone(tmp_path: Path) -> None:
    plan, kept = make_plan(tmp_path), tmp_path / "kept"
    _finish_all(plan)
    keep(plan, kept)
    shutil.rmtree(plan.out)
    clip = plan.train[0]
    clip.write_bytes(clip.read_bytes() + b"\0")
    again = make_plan(tmp_path)
    write_json(kept / "notes.json", {})
    taken = take_over(again, kept)
    assert not any(job.done.is_file() for job in again.jobs() if job.run)
    assert all(name.startswith("simulator") for name in taken)  # of the test clips alone


def test_a_file_is_refused_before_anything_is_done(tmp_path: Path) -> None:
    path, kept = write_benchmark(tmp_path), tmp_path / "kept"
    kept.write_text("")
    with pytest.raises(ValueError, match=r"--keep .*kept is a file; name a folder for the records"):
        runner.benchmark(path, kept=kept, show=lambda text: None)
    assert not (tmp_path / "out" / "runs").exists()
