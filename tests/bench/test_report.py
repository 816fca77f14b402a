"""The report of a finished benchmark, of an empty one, and that both hold every plot."""

import csv
import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from garment_jax.bench import pictures
from garment_jax.bench.plan import ROLL, Plan
from garment_jax.bench.plots import _draw, _enlarged, _figure, _front_line, _Mark, _top, all_plots
from garment_jax.bench.records import gather
from garment_jax.bench.report import write_report
from garment_jax.bench.runner import next_job
from tests.bench.made import finish, make_plan, write_rollouts

DRAWN = ("ours", "auto_encoder", "no_previous_state")


def told(plan: Plan) -> dict:
    return {"benchmark": "benchmark.toml", "data": "d", "out": str(plan.out), "quick": False, "only": []}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    """A benchmark with made-up figures and real sequence files, and its report with tiny pictures."""
    patch = pytest.MonkeyPatch()
    patch.setattr(pictures, "HEIGHT", 48)
    patch.setattr(pictures, "COLUMNS", 2)
    plan = make_plan(tmp_path_factory.mktemp("finished"))
    while (job := next_job(plan, {})) is not None:
        finish(plan, job)
    for name in DRAWN:
        job = plan.roll_job(plan.loaded.row(name), 0)
        assert job.kind == ROLL
        write_rollouts(plan, job)
    write_report(plan, told(plan))
    patch.undo()
    return plan


def test_the_page_holds_every_plot_and_picture_and_fetches_nothing(finished: Plan) -> None:
    page = (finished.out / "report.html").read_text()
    plots = all_plots(gather(finished), finished.settings.lengths)
    assert len(plots) == 6
    assert page.count("<svg") == len(plots)
    for title in plots:
        assert f"<h2>{title}</h2>" in page
    assert page.count("data:image/png;base64,") == 4  # reconstruction, methods, their error, latent
    assert 'src="http' not in page
    assert "href=" not in page.replace("xlink:href", "")
    assert page.count("<table>") == 10
    assert "ours &amp; all" in page


def test_every_plot_is_a_file_of_its_own_linked_from_the_markdown(finished: Plan) -> None:
    text = (finished.out / "report.md").read_text()
    for title, svg in all_plots(gather(finished), finished.settings.lengths).items():
        found = re.search(rf"!\[{re.escape(title)}\]\((plots/[a-z_]+\.svg)\)", text)
        assert found is not None, title
        written = (finished.out / found[1]).read_text()
        assert written == svg + "\n"
        assert ElementTree.fromstring(written).tag.endswith("svg")


def test_every_row_is_in_the_pareto_plot(finished: Plan) -> None:
    plot = all_plots(gather(finished), finished.settings.lengths)["Error against run time"]
    for row in finished.settings.rows:
        shown = row.title.replace("&", "&amp;") in plot
        assert shown == (row.task == "rollout"), row.name
    assert "open: not measured yet" not in plot


@pytest.mark.parametrize(
    ("errors", "top"),
    [([4.7, 5.0, 10.9], 5.5), ([4.7, 5.0, 7.0], 7.0), ([4.7], 4.7), ([0.0, 3.0], 3.0)],
)
def test_one_error_far_above_the_others_does_not_set_the_axis(errors: list[float], top: float) -> None:
    assert _top(errors) == pytest.approx(top)


def test_nor_does_the_front_that_begins_with_it() -> None:
    points = [(1.0, 4.5), (0.2, 10.9), (0.3, 5.0), (2.0, 4.7)]
    assert _front_line(points, 5.5) == [(0.2, 5.5), (0.3, 5.0), (1.0, 4.5)]


@pytest.mark.parametrize(("floor", "room"), [(2.0, True), (3.8, False)])
def test_a_crowd_is_enlarged_between_the_best_row_and_the_floor(
    finished: Plan, floor: float, room: bool
) -> None:
    records = gather(finished)._replace(floor=[{"rmse_cm": floor}])
    crowd = [_Mark(k, 2.0 + k, 4.0 + 0.02 * k, None, "r", "o") for k in range(6)]
    _, axes = _figure()
    axes.set(xscale="log", xlim=(0.1, 10.0), ylim=(1.5, 6.0))
    inset = _enlarged(axes, records, crowd, crowd)
    assert (inset is not None) is room
    if room:
        (left, low), (right, high) = axes.transData.inverted().transform(
            inset.get_window_extent().get_points()
        )
        assert floor < low < high < 4.0
        assert 0.1 < left < right < 10.0
        assert all(inset.get_xlim()[0] < m.x < inset.get_xlim()[1] for m in crowd)
        assert all(inset.get_ylim()[0] < m.y < inset.get_ylim()[1] for m in crowd)


def test_and_beside_all_rows_where_the_best_one_leaves_no_room_below(finished: Plan) -> None:
    records = gather(finished)._replace(floor=[{"rmse_cm": 2.8}])
    crowd = [_Mark(k, 2.0 + k, 4.4 + 0.02 * k, None, "r", "o") for k in range(6)]
    best = _Mark(6, 2.1, 3.9, None, "r", "o")
    _, axes = _figure()
    axes.set(xscale="log", xlim=(0.1, 10.0), ylim=(2.5, 9.0))
    inset = _enlarged(axes, records, [*crowd, best], crowd)
    assert inset is not None
    (left, low), (right, high) = axes.transData.inverted().transform(inset.get_window_extent().get_points())
    assert 4.5 < low < high < 9.0
    assert 0.1 < left < right < 10.0
    assert all(inset.get_ylim()[0] < m.y < inset.get_ylim()[1] for m in crowd)
    assert best.y < inset.get_ylim()[0]


def test_nor_is_it_laid_over_marks_whose_axes_are_not_yet_scaled(finished: Plan) -> None:
    records = gather(finished)._replace(floor=None, simulator=None)
    marks = [_Mark(k, 1.0 + k, 4.4 + 0.02 * k, None, "r", "o") for k in range(6)]
    marks += [_Mark(6, 0.1, 6.0, None, "r", "o"), _Mark(7, 90.0, 4.1, None, "r", "o")]
    _, axes = _figure()
    axes.set(xscale="log")
    _draw(axes, marks)
    inset = _enlarged(axes, records, marks, marks[:6])
    assert inset is not None
    low = axes.transData.inverted().transform(inset.get_window_extent().get_points())[0]
    assert all(m.x < low[0] or m.y < low[1] for m in marks)


def test_markdown_json_and_csv_say_the_same(finished: Plan) -> None:
    text = (finished.out / "report.md").read_text()
    facts = json.loads((finished.out / "report.json").read_text())
    with open(finished.out / "report.csv", newline="") as file:
        lines = list(csv.DictReader(file))
    assert "| ours & all |" in text
    ours = next(row for row in facts["rows"] if row["name"] == "ours")
    assert [m["seed"] for m in ours["measured"]] == [0, 7]
    assert set(ours["measured"][0]["clips"]) == {"tango_1", "tango_2"}
    first = next(line for line in lines if line["row"] == "ours" and line["seed"] == "0")
    assert float(first["rmse_cm"]) == ours["measured"][0]["clips"]["tango_1"]["metrics"]["rmse_cm"]
    assert len(lines) == 2 * sum(len(row["measured"]) for row in facts["rows"])
    assert all(trained["run"] in text for row in facts["rows"] for trained in row["trained"])


def test_an_empty_benchmark_has_a_report_of_open_cells(tmp_path: Path) -> None:
    plan = make_plan(tmp_path)
    write_report(plan, told(plan))
    page = (plan.out / "report.html").read_text()
    assert page.count("<svg") == 6
    assert "0 of 6 rows measured" in page
    assert "| ours & all | open |" in (plan.out / "report.md").read_text()
    assert not list(plan.out.glob("*.tmp"))
