"""What is done in which order, what is shared, and what a change of the file makes anew."""

import dataclasses
import shutil
from pathlib import Path

import pytest

from garment_jax.bench import plan as bench_plan
from garment_jax.bench.plan import Job, Plan
from garment_jax.bench.plan import test_clips as clips_to_test
from garment_jax.bench.runner import next_job
from tests.bench.made import TEXT, finish, make_plan, row_of


def words(plan: Plan) -> list[tuple[str, str, int, float]]:
    return [(job.kind, job.row, job.seed, job.rate) for job in plan.jobs()]


def finish_all(plan: Plan) -> list[Job]:
    done: list[Job] = []
    while (job := next_job(plan, {})) is not None:
        finish(plan, job)
        done.append(job)
    return done


def test_main_rows_come_first_then_search_seeds_and_the_rest(tmp_path: Path) -> None:
    order = words(make_plan(tmp_path))
    kinds = [word[:3] for word in order]
    first = [(kind, "ours", 0) for kind in ("train", "roll", "time", "latent")]
    assert kinds[:4] == first
    assert kinds.index(("train", "auto_encoder", 0)) < order.index(("train", "ours", 0, 0.5))
    assert order.index(("train", "ours", 0, 0.5)) < kinds.index(("roll", "ours", 7))
    assert kinds.index(("roll", "ours", 7)) < kinds.index(("roll", "ours_half", 0))
    assert ("time", "auto_encoder", 0) not in kinds  # a reconstruction has no run time
    assert kinds[-1][0] == "simulate"


def test_rows_with_the_same_values_share_a_run(tmp_path: Path) -> None:
    plan = make_plan(tmp_path)
    runs = {row.name: plan.train_job(row, 0).run for row in plan.settings.rows}
    assert runs["no_collision"] == runs["auto_encoder"] == runs["ours"]
    assert len({runs[n] for n in ("ours", "no_previous_state", "skinned_template", "ours_half")}) == 4
    results = {plan.roll_job(row, 0).done for row in plan.settings.rows}
    assert len(results) == len(plan.settings.rows)


def test_a_finished_search_gives_the_rate_and_what_hangs_on_it_is_done_anew(tmp_path: Path) -> None:
    plan = make_plan(tmp_path)
    before = plan.train_job(row_of(plan, "ours"), 0).run
    done = finish_all(plan)  # `finish` makes the lower rate the better one
    assert plan.rate("ours") == 0.5
    after = plan.train_job(row_of(plan, "ours"), 0)
    assert after.run != before
    assert [j.run for j in done if j.kind == "train" and j.row == "ours" and j.seed == 0][-1] == after.run
    assert plan.rate("skinned_template") == 1.0


def test_a_search_that_diverged_everywhere_changes_nothing(tmp_path: Path) -> None:
    plan = make_plan(tmp_path)
    for job in plan.search_jobs("ours"):
        finish(plan, job, validation_cm=None, diverged="the loss is nan")
    assert plan.rate("ours") == 1.0


def test_nothing_is_done_twice_and_a_lost_file_is_made_again(tmp_path: Path) -> None:
    plan = make_plan(tmp_path)
    done = finish_all(plan)
    assert len({job.done for job in done}) == len(done)
    assert next_job(make_plan(tmp_path), {}) is None
    lost = plan.roll_job(row_of(plan, "no_previous_state"), 0)
    lost.done.unlink()
    assert next_job(make_plan(tmp_path), {}) == lost


def test_other_metrics_settings_measure_anew_but_train_nothing(tmp_path: Path) -> None:
    finish_all(make_plan(tmp_path))
    job = next_job(make_plan(tmp_path, TEXT.replace("every = 6", "every = 3")), {})
    assert job is not None
    assert job.kind == "roll"


def test_a_changed_test_clip_measures_anew(tmp_path: Path) -> None:
    finish_all(make_plan(tmp_path))
    clip = tmp_path / "data" / "test" / "tango_2.h5"
    clip.write_bytes(clip.read_bytes() + b"x")
    job = next_job(make_plan(tmp_path), {})
    assert job is not None
    assert job.kind == "roll"


def test_what_failed_or_diverged_holds_nothing_up(tmp_path: Path) -> None:
    plan = make_plan(tmp_path)
    first = next_job(plan, {})
    assert first is not None
    second = next_job(plan, {first.done: "failed"})
    assert second is not None
    assert (second.kind, second.row) == ("train", "no_previous_state")
    finish(plan, first, diverged="the loss is nan")
    later = next_job(plan, {})
    assert later is not None
    assert (later.kind, later.row) == ("train", "no_previous_state")


def test_parts_are_nested_keep_the_validation_clip_and_are_linked(tmp_path: Path) -> None:
    plan = make_plan(tmp_path)
    half = {path.stem for path in plan.clips_of(0.5)}
    assert "waltz_3" in half  # kept back for validation, always there
    assert len(half) == 2
    linked = sorted((plan.data_dir(0.5) / "train").glob("*.h5"))
    assert {path.stem for path in linked} == half
    assert all(path.is_symlink() and path.resolve().exists() for path in linked)
    assert plan.data_dir(1.0) == plan.data
    counts = [{p.stem for p in plan.clips_of(part)} for part in (0.1, 0.5, 1.0)]
    assert counts[0] <= counts[1] <= counts[2]


def test_parts_follow_the_data_where_clips_have_the_same_names(tmp_path: Path) -> None:
    plan = make_plan(tmp_path)
    first = plan.data_dir(0.5)
    elsewhere = tmp_path / "moved"
    shutil.copytree(plan.data, elsewhere)
    other = Plan(plan.loaded, elsewhere, plan.out)
    linked = sorted((other.data_dir(0.5) / "train").glob("*.h5"))
    assert [path.resolve() for path in linked] == [
        (elsewhere / "train" / path.name).resolve() for path in linked
    ]
    shutil.rmtree(elsewhere)  # links that dangle
    assert plan.data_dir(0.5) == first
    assert all(path.resolve().is_file() for path in (first / "train").glob("*.h5"))


def test_only_some_rows(tmp_path: Path) -> None:
    plan = make_plan(tmp_path, only=["skinned_template"])
    assert [(job.kind, job.row) for job in plan.jobs()] == [
        (k, "skinned_template") for k in ("train", "roll", "time")
    ]
    reference = TEXT.replace("every = 6", 'every = 6\nreference = "skinned_template"')
    plan = make_plan(tmp_path, reference, only=["skinned_template"])  # it has no latent space
    assert [job.kind for job in plan.jobs()] == ["train", "roll", "time"]
    with pytest.raises(ValueError, match="--only: unknown row 'x'; known are ours"):
        make_plan(tmp_path, only=["x"])


def test_test_clips_are_refused_by_name(tmp_path: Path) -> None:
    plan = make_plan(tmp_path)
    with pytest.raises(ValueError, match="test names 'polka'"):
        clips_to_test(plan.data, ["polka"])
    with pytest.raises(ValueError, match="holds no test clips"):
        clips_to_test(tmp_path, [])
    assert [path.stem for path in clips_to_test(plan.data, ["tango_2"])] == ["tango_2"]


def test_edge_lengths_make_other_rollouts_and_times_of_the_same_runs(tmp_path: Path) -> None:
    def names(text: str) -> dict[str, tuple]:
        plan = make_plan(tmp_path, text)
        rows = [row for row in plan.settings.rows if row.task == "rollout"]
        found = {
            row.name: (plan.train_job(row, 0).run, plan.roll_job(row, 0).done, plan.time_job(row).done)
            for row in rows
        }
        auto = row_of(plan, "auto_encoder")
        return found | {"auto_encoder": (plan.train_job(auto, 0).run, plan.roll_job(auto, 0).done)}

    off, on = (
        names(TEXT.replace("[search]", f"[budget.rollout]\nlengths = {word}\n[search]", 1))
        for word in ("false", "true")
    )
    assert off["auto_encoder"] == on["auto_encoder"]  # encoded and decoded: nothing comes after
    for row in ("ours", "no_collision", "skinned_template"):
        assert off[row][0] == on[row][0]
        assert off[row][1] != on[row][1]
        assert off[row][2] != on[row][2]


def test_a_column_rnns_part_names_its_results_where_there_is_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def named(rollout: str, steps: int) -> str:
        plan = make_plan(
            tmp_path, f"{TEXT}\n[budget.column_rnn]\nsteps = {steps}\n[budget.rollout]\n{rollout}\n"
        )
        return plan.roll_job(row_of(plan, "ours"), 0).done.name

    now = named("column_rnn = 0.6", 5)
    assert now != named("column_rnn = 0.7", 5)
    assert named("column_rnn = 0.7", 0) == named("", 0)
    monkeypatch.setattr(bench_plan, "CORRECTED", 3)
    assert named("column_rnn = 0.6", 5) != now  # a correction that does something else


def test_what_contacts_do_names_rollouts_that_handle_them_and_no_run_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = make_plan(tmp_path, TEXT)
    row = row_of(plan, "ours")
    free = dataclasses.replace(row, collision=False)

    def names() -> tuple[str, str, str]:
        return plan.roll_job(row, 0).done.name, plan.roll_job(free, 0).done.name, plan.time_job(row).done.name

    before = names()
    monkeypatch.setattr(bench_plan, "CONTACTS", bench_plan.CONTACTS + 1)
    after = names()
    assert after[0] != before[0]
    assert after[1:] == before[1:]
