"""The report's plots as SVG text; matplotlib is imported here and in no other file of this room."""

import io
from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from garment_jax.bench.front import pareto_front
from garment_jax.bench.labels import RINGS, place_labels
from garment_jax.bench.records import Records, RowRecord, first_error, is_ours, spread, training_seconds
from garment_jax.bench.tables import PREVIOUS_STATE

OURS_INK, OTHER_INK, FLOOR_INK = "#c2502e", "#3b6b9e", "#4d7f4d"

CROWD, MANY = 1.06, 6  # rows so near the middle one, and so many of them, are enlarged


def all_plots(records: Records, lengths: Sequence[int]) -> dict[str, str]:
    """Return title -> SVG of every plot; one without any figure yet says so."""
    return {
        "Error against run time": pareto_plot(records),
        "Error along the rollout, with and without previous state": rollout_plot(records, lengths),
        "Error by frame": frame_plot(records),
        "Error against training data": data_plot(records),
        "Error against training time": time_plot(records),
        "Search over the learning rate": search_plot(records),
    }


def pareto_plot(records: Records) -> str:
    """RMSE against milliseconds a frame (log), every timed rollout row, the front drawn, a crowd enlarged."""
    shown = [(r, spread(r, "rmse_cm")) for r in records.rows if r.time and not r.reconstructs]
    shown = [(r, found) for r, found in shown if found is not None]
    figure, axes = _figure(height=7.2)
    points = [(r.time["ms_per_frame"], found.mean) for r, found in shown if r.time]
    top = _top([y for _, y in points])
    marks = []
    for k, ((r, found), (x, y)) in enumerate(zip(shown, points, strict=True), start=1):
        ink, mark = (OURS_INK, "o") if is_ours(r) else (OTHER_INK, "s")
        marks.append(_Mark(k, x, y, found.std, ink, mark) if y <= top else _Mark(k, x, top, None, ink, "^"))
        axes.plot(
            [], [], marks[-1].shape, ms=5, color=ink, label=f"{k}  {r.row.title}: {y:.2f} cm, {x:.2g} ms"
        )
    front = _front_line(points, top)
    if front:
        line = {"color": "0.45", "lw": 1, "ls": "--", "label": "Pareto front", "zorder": 0}
        axes.step(*zip(*front, strict=True), where="post", **line)
    if records.simulator:
        x = records.simulator["ms_per_frame"]
        axes.axvline(x, color="0.3", lw=1, ls=":", label=f"simulator, {x:.0f} ms a frame")
    _floor(axes, records)
    axes.set(xlabel="milliseconds a frame, one stream", ylabel="RMSE, cm, mean of test clips", xscale="log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    _draw(axes, marks)
    middle = float(np.median([m.y for m in marks])) if marks else 0.0
    crowd = [m for m in marks if middle / CROWD <= m.y <= CROWD * middle]
    enlarged = _enlarged(axes, records, marks, crowd) if len(crowd) >= MANY else None
    if enlarged is not None:
        _draw(enlarged, crowd)
    beside = [(axes, [m for m in marks if enlarged is None or m not in crowd])]
    beside += [] if enlarged is None else [(enlarged, crowd)]
    return _svg(figure, axes, empty=not shown, beside=True, numbered=beside)


class _Mark(NamedTuple):
    """A row in the plot."""

    number: int
    x: float
    y: float
    error: float | None
    ink: str
    shape: str


def _draw(axes: Any, marks: Sequence[_Mark]) -> None:
    for m in marks:
        axes.errorbar(m.x, m.y, yerr=m.error, fmt=m.shape, ms=5, color=m.ink, capsize=2, lw=1)


def _enlarged(axes: Any, records: Records, marks: Sequence[_Mark], crowd: Sequence[_Mark]) -> Any:
    """Return axes that enlarge a crowd in an empty space, under all marks or beside them, if one is large."""
    axes.autoscale_view()  # only now are limits those of what is drawn
    place = _under(axes, records, marks) or _beside(axes, records, marks)
    if place is None:
        return None
    inset = axes.inset_axes(place)
    x, y = np.log10([m.x for m in crowd]), [m.y for m in crowd]
    inset.set(xscale="log", xlim=10 ** (np.array([min(x), max(x)]) + [-0.04, 0.04]))
    inset.set_ylim(min(y) - 0.15 * np.ptp(y), max(y) + 0.15 * np.ptp(y))
    inset.xaxis.set_major_locator(LogLocator(subs=tuple(range(1, 10))))
    inset.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    inset.xaxis.set_minor_formatter(NullFormatter())
    inset.tick_params(labelsize=7)
    inset.grid(color="0.92", lw=0.6)
    axes.indicate_inset_zoom(inset, edgecolor="0.6")
    return inset


def _under(axes: Any, records: Records, marks: Sequence[_Mark]) -> tuple[float, float, float, float] | None:
    """Return the space between the floor and the best row, in parts of the axes."""
    if not records.floor:
        return None
    low, high = axes.get_ylim()
    floor = float(np.mean([f["rmse_cm"] for f in records.floor]))
    bottom, best = ((y - low) / (high - low) for y in (floor, min(m.y for m in marks)))
    return (0.08, bottom + 0.08, 0.88, best - bottom - 0.16) if best - bottom >= 0.35 else None


def _beside(axes: Any, records: Records, marks: Sequence[_Mark]) -> tuple[float, float, float, float] | None:
    """Return the space above the slower half's rows, short of the simulator, in parts of the axes."""

    def place(x: float, y: float) -> tuple[float, float]:
        return tuple(axes.transAxes.inverted().transform(axes.transData.transform((x, y))))

    left, right = 0.5, 0.97
    lowest = [place(1.0, f["rmse_cm"])[1] for f in records.floor or ()]
    lowest += [y for x, y in (place(m.x, m.y) for m in marks) if x > left - 0.05]
    bottom = max(lowest, default=0.0) + 0.08
    if records.simulator:
        x = place(records.simulator["ms_per_frame"], 1.0)[0]
        right = x - 0.02 if left < x < 1.0 else right
    return (left, bottom, right - left, 0.97 - bottom) if bottom <= 0.62 and right - left >= 0.3 else None


def _number(figure: Any, axes: Any, marks: Sequence[_Mark]) -> None:
    """Write the rows' numbers beside their marks, with a line to those that are crowded out."""
    per_point = figure.dpi / 72
    places = axes.transData.transform([(m.x, m.y) for m in marks]) / per_point
    sizes = [(5.0 * len(str(m.number)) + 1, 8.0) for m in marks]
    line = {"arrowstyle": "-", "lw": 0.5, "shrinkA": 4, "shrinkB": 2}
    for m, offset in zip(marks, place_labels([tuple(p) for p in places], sizes), strict=True):
        far = np.hypot(*offset) > 1.2 * RINGS[0]
        axes.annotate(
            str(m.number),
            (m.x, m.y),
            xytext=tuple(offset),
            textcoords="offset points",
            fontsize=8,
            color=m.ink,
            ha="center",
            va="center",
            arrowprops=line | {"color": m.ink} if far else None,
        )


def _top(errors: Sequence[float]) -> float:
    """Return where the error axis ends: one method far above all others stands at the edge, as a triangle."""
    second, worst = [0.0, *sorted(errors)][-2:] if errors else (0.0, np.inf)
    return 1.1 * second if worst > 1.5 * second > 0 else worst


def _front_line(points: Sequence[tuple[float, float]], top: float) -> list[tuple[float, float]]:
    """Return the corners of the front: the quickest method is on it however far above `top` its error is."""
    return [(points[i][0], min(points[i][1], top)) for i in pareto_front(points)]


def rollout_plot(records: Records, lengths: Sequence[int]) -> str:
    """RMSE of the first frames of the rollout, with and without previous state."""
    figure, axes = _figure()
    lines = [
        (record, ink, dash)
        for pair, dash in zip(PREVIOUS_STATE, ("-", "--"), strict=True)
        if records.named(pair[1]) is not None or pair == PREVIOUS_STATE[0]
        for record, ink in zip(map(records.named, pair), (OURS_INK, OTHER_INK), strict=True)
        if record is not None
    ]
    for record, ink, dash in lines:
        for clip in records.clips:
            found = [(k, first_error(record, k, clip=clip)) for k in lengths]
            found = [(k, f.mean) for k, f in found if f is not None]
            if not found:
                continue
            longest = len(found) == len(lengths)
            axes.plot(
                *zip(*found, strict=True),
                "o",
                ls=dash,
                color=ink,
                lw=1.8 if longest else 0.7,
                ms=4,
                alpha=1 if longest else 0.45,
            )
            k, y = found[-1]
            if dash == "-":  # the second pair's names would lie on the first's
                axes.annotate(clip, (k, y), xytext=(5, 0), textcoords="offset points", fontsize=7, color=ink)
        axes.plot([], [], color=ink, ls=dash, label=record.row.title)
    _floor(axes, records)
    axes.set(xlabel="first frames of the rollout", ylabel="RMSE, cm", xscale="log")
    axes.set_xticks(list(lengths), [str(k) for k in lengths])
    axes.minorticks_off()
    axes.set_ylim(bottom=0)
    return _svg(figure, axes, empty=not lines)


def frame_plot(records: Records) -> str:
    """The longest clip's error by frame, smoothed over a second, of the rows compared."""
    names = ("ours_column_rnn", "ours", "no_previous_state", "pan_2022", "santesteban_2019", "ridge")
    names += ("skinned_template",)
    found = [record for record in map(records.named, names) if record is not None]
    figure, axes = _figure()
    for record in found:
        clips = record.rolls[0]["clips"]
        clip = max(clips, key=lambda name: clips[name]["frames"])
        error = np.asarray(clips[clip]["rmse_cm_per_frame"], float)
        window = np.ones(min(30, len(error)))
        mean = np.convolve(error, window, "same") / np.convolve(np.ones(len(error)), window, "same")
        axes.plot(mean, lw=2.0 if record.row.name.startswith("ours") else 1.0, label=record.row.title)
        axes.set(xlabel=f"frame of {clip}, mean of 30", ylabel="RMSE, cm")
    axes.set_ylim(bottom=0)
    return _svg(figure, axes, empty=not found)


def data_plot(records: Records) -> str:
    """RMSE against the part of the training clips, by method: rows that differ in nothing but the part."""
    figure, axes = _figure()
    shown = False
    for method in dict.fromkeys(r.row.method for r in records.rows if r.row.part < 1):
        own = [r for r in records.rows if r.row.method == method and r.rolls and r.row.length == 1]
        whole = [r for r in own if r.row.part == 1][:1]
        found = [(r, spread(r, "rmse_cm")) for r in [*(r for r in own if r.row.part < 1), *whole]]
        points = sorted((100 * r.row.part, f.mean) for r, f in found if f is not None)
        if len(points) > 1:
            axes.plot(*zip(*points, strict=True), "o-", label=method)
            shown = True
    _floor(axes, records)
    axes.set(xlabel="training clips, %", ylabel="RMSE, cm (mean of the test clips)")
    axes.set_ylim(bottom=0)
    return _svg(figure, axes, empty=not shown)


def time_plot(records: Records) -> str:
    """Validation error of rollouts during training, and the test error at its end, against seconds."""
    figure, axes = _figure()
    shown = False
    own_runs = {r.trained[0]["run"]: r for r in reversed(records.rows) if _has_curve(r)}  # the first row's
    for k, record in enumerate(reversed(own_runs.values())):
        own = record.trained[0]["curve"]
        last = own[-1]["stage"]
        points = [(p["seconds"], p["rmse_cm"]) for p in own if p["stage"] in _rolled_stages(last)]
        line = axes.plot(*zip(*points, strict=True), ".-", lw=1, color=f"C{k % 10}", label=record.row.title)[
            0
        ]
        found, seconds = spread(record, "rmse_cm"), training_seconds(record)
        if found is not None and seconds:
            axes.plot(seconds, found.mean, "D", ms=6, color=line.get_color())
        shown = True
    axes.set(xlabel="seconds of training", ylabel="RMSE, cm: validation clip (lines), test (diamonds)")
    axes.set_ylim(bottom=0)
    return _svg(figure, axes, empty=not shown, beside=True)


def _has_curve(record: RowRecord) -> bool:
    """Return whether a row's validation rolled out, and it was trained on all clips."""
    return bool(
        record.row.part == 1
        and record.rolls
        and not record.reconstructs
        and record.trained
        and record.trained[0]["curve"]
    )


def _rolled_stages(last: str) -> tuple[str, ...]:
    """Return the stages whose validation is of the same kind as the last one's (ours: rollouts)."""
    return ("warm_up", "motion") if last in ("warm_up", "motion") else (last,)


def search_plot(records: Records) -> str:
    """Validation error against the factor of the learning rates, by method."""
    figure, axes = _figure()
    shown = False
    factors: set[float] = set()
    for method, found in records.searches.items():
        points = sorted((e["factor"], e["validation_cm"]) for e in found if e["validation_cm"] is not None)
        factors |= {x for x, _ in points}
        if points:
            axes.plot(*zip(*points, strict=True), "o-", label=method)
            shown = True
    axes.set(xlabel="factor of the learning rates", ylabel="RMSE on the validation clip, cm", xscale="log")
    axes.set_xticks(sorted(factors), [f"{x:g}" for x in sorted(factors)])
    axes.minorticks_off()
    axes.set_ylim(bottom=0)
    return _svg(figure, axes, empty=not shown)


def _floor(axes: Any, records: Records) -> None:
    """Draw the predictability floor: how far two simulations of the same frames differ."""
    if not records.floor:
        return
    mean = float(np.mean([f["rmse_cm"] for f in records.floor]))
    axes.axhline(mean, color=FLOOR_INK, lw=1.2, ls="-.", label=f"predictability floor, {mean:.2f} cm")


def _figure(*, height: float = 4.0) -> tuple[Any, Any]:
    figure = Figure(figsize=(9.5, height), layout="constrained")
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="0.92", lw=0.6)
    axes.set_axisbelow(True)
    return figure, axes


def _svg(
    figure: Any,
    axes: Any,
    *,
    empty: bool,
    beside: bool = False,
    numbered: Sequence[tuple[Any, Sequence[_Mark]]] = (),
) -> str:
    if empty:
        axes.text(
            0.5,
            0.5,
            "open: not measured yet",
            ha="center",
            va="center",
            transform=axes.transAxes,
            color="0.5",
        )
    elif axes.get_legend_handles_labels()[1]:
        where = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)} if beside else {"loc": "best"}
        axes.legend(frameon=False, fontsize=8, **where)
    if numbered:
        figure.canvas.draw()  # settles the layout, and with it where the marks are
    for part, marks in numbered:
        if marks:
            _number(figure, part, marks)
    file = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "garment-jax"}):  # the same figures, the same bytes
        figure.savefig(file, format="svg", metadata={"Date": None})
    text = file.getvalue()
    return text[text.index("<svg") :]
