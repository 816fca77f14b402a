"""Tables from records: ratios, deviations, what is open, what is too short."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.bench import paper
from garment_jax.bench.files import read_json
from garment_jax.bench.measuring import first_errors, mean_of
from garment_jax.bench.page import table_html
from garment_jax.bench.plots import rollout_plot
from garment_jax.bench.records import Records, gather, of_seeds, read_again, row_record, spread
from garment_jax.bench.tables import (
    OPEN,
    Table,
    comparison_table,
    error_table,
    previous_state_table,
    ratio,
    ratio_table,
    to_markdown,
)
from tests.bench.made import TEXT, finish, make_plan

KNOWN, PARTED = slice(3), slice(3, None)  # frames
SETTINGS = {"every": 6, "sted_window_frames": 15, "sted_c": 0.1, "penetration_tolerance_mm": 0.1}


def measured(folder: Path, *rows: str, seeds: int = 2) -> Records:
    """Return the records of a plan where only `rows` are done."""
    plan = make_plan(folder)
    for row in (plan.loaded.row(name) for name in rows):
        for seed in row.seeds[:seeds]:
            finish(plan, plan.train_job(row, seed))
            finish(plan, plan.roll_job(row, seed))
    return gather(plan)


def test_a_row_without_measurement_is_open_and_has_no_number(tmp_path: Path) -> None:
    table = error_table(measured(tmp_path, "ours"), SETTINGS)
    cells = {row[0]: row[1:] for row in table.rows}
    assert cells["ours & all"][-1] == "2"
    assert set(cells["skinned"][:-1]) == {OPEN}
    assert cells["skinned"][-1] == "–"


def test_seeds_give_mean_and_deviation(tmp_path: Path) -> None:
    records = measured(tmp_path, "ours")
    found = spread(records.rows[0], "rmse_cm")  # 1 and 1.7, as made up
    assert found is not None
    assert found.mean == pytest.approx(1.35)
    assert found.std == pytest.approx(np.std([1.0, 1.7], ddof=1))
    assert error_table(records, SETTINGS).rows[0][1] == "1.35 ± 0.49"
    assert of_seeds([]) is None


def test_previous_state_by_clip_and_length(tmp_path: Path) -> None:
    table = previous_state_table(measured(tmp_path, "ours", "no_previous_state", seeds=1), (5, 12))
    rows = {row[0]: row[1:] for row in table.rows}
    assert rows["ours & all, tango_1, with"] == ["1.000", "1.000"]
    assert rows["ours & all, tango_1, with ÷ without"] == ["0.500", "0.500"]
    assert rows["ours & all, tango_2, without"] == ["3.000", "–"]  # 10 frames are no 12
    assert rows["ours & all, tango_2, with ÷ without"] == ["0.667", "–"]
    assert rows["ours & all, mean of clips so long, with"] == ["1.500", "1.000"]
    assert not any(name.startswith("ours_column_rnn") for name in rows)  # not measured
    text = TEXT + "".join(
        f'[[row]]\nname = "{name}"\ntitle = "{name}"\ngroup = "main"\nset.motion.gru = {k}\n'
        for k, name in enumerate(("ours_column_rnn", "column_rnn_no_previous_state"), start=90)
    )
    plan = make_plan(tmp_path, text)
    for row in plan.settings.rows[-1:]:  # without: alone it is shown as well
        finish(plan, plan.train_job(row, 0))
        finish(plan, plan.roll_job(row, 0))
    rows = {row[0]: row[1:] for row in previous_state_table(gather(plan), (5, 12)).rows}
    assert rows["ours_column_rnn, tango_1, with"] == [OPEN, OPEN]
    assert rows["ours_column_rnn, tango_1, without"][0] != OPEN
    row = plan.settings.rows[-2]
    finish(plan, plan.train_job(row, 0))
    finish(plan, plan.roll_job(row, 0))
    records = gather(plan)
    rows = {row[0]: row[1:] for row in previous_state_table(records, (5, 12)).rows}
    top, below = (float(rows[f"ours_column_rnn, tango_1, {name}"][0]) for name in ("with", "without"))
    assert rows["ours_column_rnn, tango_1, with ÷ without"][0] == f"{top / below:.3f}"
    ratios = {row[0]: row[1:] for row in ratio_table(records, "ours_column_rnn").rows}
    means = [
        spread(records.named(name), "rmse_cm") for name in ("ours_column_rnn", "column_rnn_no_previous_state")
    ]
    assert ratios["column_rnn_no_previous_state"][0] == ratio(*means)  # of the column RNN's, not of ours
    drawn = rollout_plot(records, (5, 12))
    assert drawn.count("<!-- column_rnn_no_previous_state -->") == 1
    assert drawn.count("<!-- tango_1 -->") == 2  # names stand at the first pair alone
    assert rows["paper, walk, with ÷ without"] == [OPEN, OPEN]  # it has 100, 500 and 1200


def test_ratios_stand_beside_the_papers_and_say_what_is_missed(tmp_path: Path) -> None:
    text = TEXT.replace('"skinned_template"\ntitle', '"pan_2022"\ntitle')  # a stand-in of that name
    plan = make_plan(tmp_path, text)
    for row in plan.settings.rows:
        if row.name in ("ours", "pan_2022"):
            finish(plan, plan.train_job(row, 0))
            finish(plan, plan.roll_job(row, 0))
    table = comparison_table(gather(plan), "ours", paper.SKIRT, title="x")
    rows = [row[1:] for row in table.rows if row[0].startswith("ours ÷")]
    assert rows == [[OPEN] * 3, ["0.250"] * 3]  # 1 over 4
    assert [row[1:] for row in table.rows if "paper" in row[0]][1] == ["0.748", "0.869", "0.919"]
    assert "rmse_cm against pan_2022: 0.250 of at most 0.748, reached" in table.note


def test_a_row_of_the_references_own_run_is_held_against_the_reference(tmp_path: Path) -> None:
    rnn = "set.column_rnn.steps = 9\n"
    rows = [
        f'[[row]]\nname = "{name}"\ntitle = "{name}"\ngroup = "main"\n{rnn}' for name in ("ring", "plain")
    ]
    text = TEXT.replace("every = 6", 'every = 6\nreference = "ring"')
    plan = make_plan(tmp_path, text + "\n".join(rows) + "set.collision.iterations = 3\n")
    for row in plan.settings.rows:
        if row.name in ("ours", "ring", "plain", "no_previous_state"):
            finish(plan, plan.train_job(row, 0))
            finish(plan, plan.roll_job(row, 0))
    records = gather(plan)
    found = {row[0]: row[1] for row in ratio_table(records, "ring").rows}
    ours, ring, plain, other = (
        spread(records.named(name), "rmse_cm") for name in ("ours", "ring", "plain", "no_previous_state")
    )
    assert found["plain"] == ratio(ring, plain)  # trained as the reference was
    assert found["without previous state"] == ratio(ours, other)


def test_first_errors_are_root_mean_squares_of_the_beginning() -> None:
    error = np.array([3.0, 4.0, 0.0, 5.0])
    found = first_errors(error, (1, 2, 4, 5))
    assert found == {"1": 3.0, "2": pytest.approx(12.5**0.5), "4": pytest.approx(12.5**0.5), "5": None}


def test_means_over_clips_need_every_clip() -> None:
    assert mean_of([{"a": 1.0, "b": 2.0}, {"a": 3.0, "b": None}]) == {"a": 2.0, "b": None}


def test_a_table_says_the_same_as_markdown_and_html() -> None:
    table = Table("T & t", ["row", "x"], [["<a>", OPEN], ["b", "1.5"]], "A note.")
    lines = to_markdown(table).splitlines()
    assert lines[:4] == ["## T & t", "", "| row | x |", "|---|---:|"]
    assert lines[4] == "| <a> | open |"
    html = table_html(table)
    assert "T &amp; t" in html
    assert "<td>&lt;a&gt;</td>" in html
    assert f'<td class="open">{OPEN}</td>' in html
    assert "A note." in html


def test_errors_on_determined_frames_come_first_where_second_simulations_are_known(tmp_path: Path) -> None:
    records = measured(tmp_path, "ours", seeds=1)
    plan = make_plan(tmp_path)
    record = plan.roll_job(plan.loaded.row("ours"), 0).done
    again = []
    for name in records.clips:
        frames = len(read_json(record)["clips"][name]["rmse_cm_per_frame"])
        away = np.where(np.arange(frames) < KNOWN.stop, 0.1, 4.0)
        again.append({"clip": name, "rmse_cm": 3.0, "per_frame": away.tolist()})
    known = records._replace(rows=[row_record(plan, row, again) for row in plan.settings.rows], floor=again)
    table = error_table(known, SETTINGS)
    assert table.head[1:3] == ["RMSE cm, determined", "÷ second run elsewhere"]
    cells = dict(zip(table.head, table.rows[0], strict=True))
    errors = [np.array(read_json(record)["clips"][c]["rmse_cm_per_frame"]) for c in records.clips]
    known_part, rest = (
        np.mean([np.sqrt(np.square(error[part]).mean()) for error in errors]) for part in (KNOWN, PARTED)
    )
    assert cells["RMSE cm, determined"] == f"{known_part:.2f}"
    assert cells["÷ second run elsewhere"] == f"{rest / 4:.2f}"
    assert ratio_table(known, "ours").head[-1] == "RMSE cm, determined"


def test_a_folder_of_second_simulations_needs_every_clip(tmp_path: Path) -> None:
    plan = make_plan(tmp_path)
    assert read_again(plan) == []
    plan.again = tmp_path / "again"
    with pytest.raises(FileNotFoundError, match=r"has no .*\.h5; make it with garment-jax floor"):
        read_again(plan)
    plan.again = plan.test[0].parent  # each clip its own second simulation
    found = read_again(plan)
    assert [f["clip"] for f in found] == [path.stem for path in plan.test]
    assert all(f["rmse_cm"] == 0 and not np.any(f["per_frame"]) for f in found)
