"""The report's tables, as cells: Markdown, HTML and CSV are made of the same ones."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from garment_jax.bench import paper
from garment_jax.bench.plan import is_reconstruction
from garment_jax.bench.records import (
    Records,
    RowRecord,
    Spread,
    common,
    first_error,
    is_ours,
    run_names,
    spread,
    training_seconds,
)
from garment_jax.bench.settings import OURS

OPEN = "open"
PREVIOUS_STATE = (
    ("ours", "no_previous_state"),
    ("ours_column_rnn", "column_rnn_no_previous_state"),
)  # with, without
DETAIL_ROWS = ("no_detail", "no_discriminator", "ours")
COMPARED = ("santesteban_2019", "pan_2022")
ERRORS: tuple[tuple[str, str, str], ...] = (  # heading, metric, format
    ("RMSE cm", "rmse_cm", ".2f"),
    ("mean dist. cm", "mean_distance_cm", ".2f"),
    ("Hausdorff cm", "hausdorff_cm", ".2f"),
    ("STED", "sted", ".4f"),
    ("inside %", "inside_percent", ".2f"),
    ("deepest mm", "deepest_mm", ".1f"),
    ("strain %", "strain_mean_percent", ".2f"),
    ("Laplacian power ÷ truth", "laplacian_power_ratio", ".2f"),
    ("hem motion ÷ truth", "hem_motion_std_ratio", ".2f"),
)


KNOWN: tuple[tuple[str, str, str], ...] = (  # where second simulations are known
    ("RMSE cm, determined", "determined_rmse_cm", ".2f"),
    ("÷ second run elsewhere", "parted_error_ratio", ".2f"),
)


class Table(NamedTuple):
    """A table with its heading; the first column is text, the others right-aligned."""

    title: str
    head: list[str]
    rows: list[list[str]]
    note: str = ""


def cell(value: Spread | None, form: str) -> str:
    """Return a figure as it is printed: mean, ± deviation where there are seeds, or open."""
    if value is None:
        return OPEN
    return format(value.mean, form) + ("" if value.std is None else f" ± {format(value.std, form)}")


def number(value: float | None, form: str, *, scale: float = 1.0) -> str:
    return OPEN if value is None else format(value * scale, form)


def ratio(a: Spread | None, b: Spread | None) -> str:
    """Return a / b of two means, or open."""
    return OPEN if a is None or b is None or not b.mean else f"{a.mean / b.mean:.3f}"


def error_table(records: Records, settings: dict) -> Table:
    """Every row, every metric: means over the test clips."""
    errors = (*KNOWN, *ERRORS) if records.floor else ERRORS
    head = ["method", *(heading for heading, _, _ in errors), "seeds"]
    rows = []
    for r in records.rows:
        cells = [cell(spread(r, metric), form) for _, metric, form in errors]
        rows.append([_title(r), *cells, str(len(r.rolls)) if r.rolls else "–"])
    note = (
        f"Plain means over {len(records.clips)} test clips, whole rollouts from the skinned template (rows "
        "that encode the truth: reconstructions). ± is the standard deviation over seeds. "
        f"STED: one-ring, window {settings['sted_window_frames']} frames, c = {settings['sted_c']:g}. "
        f"Hausdorff, inside and deepest on one frame in {settings['every']}; inside = more than "
        f"{settings['penetration_tolerance_mm']:g} mm deep; deepest: mean over clips of the clip's deepest."
    )
    return Table("Errors", head, rows, note)


def cost_table(records: Records) -> Table:
    """Every rollout row: run time, memory, size, training."""
    head = ["method", "ms a frame", "p95", "step ms", "p95", "frames/s, batch", "start-up s", "compile s"]
    head += ["peak MB", "parameters", "MB stored", "training s", "CPU s"]
    rows = []
    for r in (r for r in records.rows if not _rebuilds(r)):
        t = r.time or {}
        cells = [number(t.get(k), ".2f") for k in ("ms_per_frame", "ms_per_frame_p95")]
        alone = [number(t.get(k), ".2f") for k in ("step_ms", "step_ms_p95")]
        alone += [number(t.get("batch_frames_per_s"), ".0f")]
        cells += ["–" if t and text == OPEN else text for text in alone]  # not what this row does
        cells += [number(t.get("start_up_s"), ".1f")]
        cells += [number(t.get("compile_s"), ".1f"), number(t.get("peak_mb"), ".0f")]
        cells += [number(t.get("parameters"), ",.0f"), number(t.get("bytes"), ".1f", scale=1e-6)]
        cpu = r.trained[0].get("cpu_seconds") if r.trained else None
        rows.append([_title(r), *cells, number(training_seconds(r), ".0f"), number(cpu, ".0f")])
    s = records.simulator or {}
    simulator = [number(s.get(k), ".0f") for k in ("ms_per_frame", "ms_per_frame_p95")]
    rows.append(["simulator (the truth)", *simulator, *(["–"] * (len(head) - 3))])
    batch = next((r.time["batch"] for r in records.rows if r.time and r.time.get("batch")), None)
    note = (
        "One stream. Milliseconds a frame: median and 95th percentile over chunks after the first, from "
        "motion to garment in the world (pins, stretch, limbs and collisions unless the row says otherwise). "
        "Step: the compiled networks alone, one frame in and out, waited for each time. "
        f"Batch: {batch or 'several'} motions side by side, without collision handling. Start-up: process, "
        "imports and loading. Training: seconds of the first seed, shared stages counted in; CPU: "
        "of all cores, of this run's own processes."
    )
    return Table("Cost", head, rows, note)


def clip_table(records: Records) -> Table:
    """RMSE of every row on every clip."""
    rows = [
        [
            _title(r),
            *(cell(spread(r, "rmse_cm", clip=c), ".2f") for c in records.clips),
            cell(spread(r, "rmse_cm"), ".2f"),
        ]
        for r in records.rows
    ]
    return Table("RMSE by clip, cm", ["method", *records.clips, "mean"], rows)


def previous_state_table(records: Records, lengths: Sequence[int]) -> Table:
    """In the form of the paper's Table 1: error along the rollout with and without previous state."""
    rows = []
    for with_name, without_name in PREVIOUS_STATE:
        ours, other = records.named(with_name), records.named(without_name)
        if with_name != OURS and other is None:
            continue  # the paper's pair stands open where it is not measured
        a_seeds, b_seeds = common(ours, other)
        method = _row_title(records, with_name)
        for clip in [*records.clips, ""]:
            name = f"{method}, {clip or 'mean of clips so long'}"
            for title, record in (("without", other), ("with", ours)):
                rows.append([f"{name}, {title}", *(_first(record, k, clip) for k in lengths)])
            pairs = [(_first_spread(a_seeds, k, clip), _first_spread(b_seeds, k, clip)) for k in lengths]
            rows.append([f"{name}, with ÷ without", *(_dash_ratio(a, b, ours, other) for a, b in pairs)])
    for motion, known in paper.PREVIOUS_STATE.items():
        rows.append([f"paper, {motion}, with ÷ without", *(number(known.get(k), ".3f") for k in lengths)])
    note = "RMSE in cm of a rollout's first frames. A dash: the clip is shorter. "
    return Table("Table 1: previous state", ["clip", *(f"{k} frames" for k in lengths)], rows, note)


def detail_table(records: Records) -> Table:
    """In the form of the paper's Table 2: the detail module."""
    found = {name: records.named(name) for name in DETAIL_ROWS}
    titles = ("no module", "module without discriminator", "full module")
    rows = []
    for metric, what in (("rmse_cm", "RMSE cm"), ("laplacian_power_ratio", "Laplacian ÷ truth")):
        for title, name in zip(titles, DETAIL_ROWS, strict=True):
            rows.append([f"{title}, {what}", *_by_clip(found[name], metric, ".3f", records.clips)])
    full, none = common(found["ours"], found["no_detail"])
    ratios = [
        ratio(full and spread(full, "rmse_cm", clip=c), none and spread(none, "rmse_cm", clip=c))
        for c in [*records.clips, ""]
    ]
    rows.append(["full ÷ none, RMSE", *ratios])
    known = ", ".join(f"{motion} {value:.3f}" for motion, value in paper.DETAIL.items())
    note = f"The paper's full ÷ none, RMSE, on its motions: {known}. All three rows share stages 1 and 2."
    return Table("Table 2: detail module", ["row", *records.clips, "mean"], rows, note)


def comparison_table(records: Records, reference: str, known: dict, *, title: str) -> Table:
    """In the form of the paper's Tables 3 and 4: ours against the others, ratios beside the paper's."""
    ours = records.named(reference)
    forms: dict[str, str] = dict(zip(paper.METRICS, (".2f", ".2f", ".4f"), strict=True))
    metrics = _metrics(records)
    rows = []
    for name in [*COMPARED, reference]:
        record = records.named(name)
        cells = [cell(record and spread(record, m), forms.get(m, ".2f")) for m in metrics]
        rows.append([_row_title(records, name), *cells])
    for name in COMPARED:
        rows.append([f"ours ÷ {_row_title(records, name)}", *_ratios(records, ours, records.named(name))])
        papers = [f"{value:.3f}" for value in known[name]]
        rows.append(["the paper's ratio", *papers, *(["–"] * (len(metrics) - len(papers)))])
    head = [
        "method",
        "RMSE cm",
        "Hausdorff cm",
        "STED",
        *(heading for heading, m, _ in KNOWN if m in metrics),
    ]
    return Table(title, head, rows, _reached(records, ours, known))


def vto_table(command: str) -> Table:
    """Table 4 while the vto-dataset is not at hand: the paper's ratios and the command for the rest."""
    rows = []
    for name in COMPARED:
        rows.append([f"ours ÷ {name}", OPEN, OPEN, OPEN])
        rows.append(["the paper's ratio", *(f"{value:.3f}" for value in paper.VTO[name])])
    note = f"Open: the data cannot be shipped. Import it (garment-jax import), then: {command}"
    return Table("Table 4: vto-dataset", ["method", "RMSE cm", "Hausdorff cm", "STED"], rows, note)


def ratio_table(records: Records, reference: str) -> Table:
    """The reference divided by every other rollout row; by those of ours, that which they are taken from."""
    ours, plain = records.named(reference), records.named(OURS) or records.named(reference)
    whole = {without: records.named(name) for name, without in PREVIOUS_STATE}
    rows = []
    for r in (r for r in records.rows if r.row.name != reference and not _rebuilds(r)):
        of_plain = is_ours(r) and r.row.name != OURS and not (ours and _run_of(r) == _run_of(ours))
        top = plain if of_plain else ours
        rows.append([_title(r), *_ratios(records, whole.get(r.row.name) or top, records.named(r.row.name))])
    note = "Over the seeds that both rows have, as all ratios here. Variants of ours: the row 'ours' "
    note += "divided; of the column RNN's, the row with the column RNN."
    head = [
        "other",
        "RMSE",
        "Hausdorff",
        "STED",
        *(heading for heading, m, _ in KNOWN if m in _metrics(records)),
    ]
    return Table("Ours ÷ other", head, rows, note)


def provenance_table(records: Records, out: Path) -> Table:
    """Where every row comes from: run folders, seeds, learning rate, steps, clips."""
    rows = []
    for r in records.rows:
        first = r.trained[0] if r.trained else {}
        seeds = ", ".join(str(t["seed"]) for t in r.trained) or "–"
        facts = [number(first.get("rate"), "g"), number(first.get("length"), "g")]
        facts.append(str(len(first["clips"])) if first else OPEN)
        rows.append([_title(r), "; ".join(run_names(r, out)) or OPEN, seeds, *facts])
    head = ["row", "run folders", "seeds", "rates ×", "length ×", "clips"]
    return Table("Where the rows come from", head, rows)


def search_table(records: Records) -> Table:
    """The learning-rate search: validation error at each factor."""
    factors = sorted({entry["factor"] for found in records.searches.values() for entry in found})
    rows = []
    for method, found in records.searches.items():
        known = {entry["factor"]: entry for entry in found}
        rows.append([method, *(_searched(known.get(f)) for f in factors)])
    return Table("Search: validation RMSE in cm", ["method", *(f"rates × {f:g}" for f in factors)], rows)


def _run_of(record: RowRecord) -> str:
    return record.rolls[0]["run"] if record.rolls else ""


def _metrics(records: Records) -> tuple[str, ...]:
    """Return what methods are compared by: the paper's three, and the error where it can be known."""
    return (*paper.METRICS, "determined_rmse_cm") if records.floor else paper.METRICS


def _ratios(records: Records, ours: RowRecord | None, other: RowRecord | None) -> list[str]:
    a, b = common(ours, other)
    return [ratio(a and spread(a, metric), b and spread(b, metric)) for metric in _metrics(records)]


def _searched(entry: dict | None) -> str:
    if entry is None:
        return OPEN
    return "diverged" if entry["diverged"] else number(entry["validation_cm"], ".3f")


def _reached(records: Records, ours: RowRecord | None, known: dict) -> str:
    words = []
    for name in COMPARED:
        pair = common(ours, records.named(name))
        for metric, bound in zip(paper.METRICS, known[name], strict=True):
            a, b = (r and spread(r, metric) for r in pair)
            if a is None or b is None:
                continue
            value = a.mean / b.mean
            verdict = "reached" if value <= bound else f"missed by {value - bound:.3f}"
            words.append(f"{metric} against {name}: {value:.3f} of at most {bound:g}, {verdict}")
    return "; ".join(words) + "." if words else ""


def _by_clip(record: RowRecord | None, metric: str, form: str, clips: Sequence[str]) -> list[str]:
    return [cell(record and spread(record, metric, clip=c), form) for c in [*clips, ""]]


def _first_spread(record: RowRecord | None, length: int, clip: str) -> Spread | None:
    return record and first_error(record, length, clip=clip)


def _first(record: RowRecord | None, length: int, clip: str) -> str:
    if record is None:
        return OPEN
    found = first_error(record, length, clip=clip)
    return "–" if found is None else cell(found, ".3f")


def _dash_ratio(a: Spread | None, b: Spread | None, ours: RowRecord | None, other: RowRecord | None) -> str:
    return OPEN if ours is None or other is None else ("–" if a is None or b is None else ratio(a, b))


def _rebuilds(record: RowRecord) -> bool:
    return is_reconstruction(record.row)


def _title(record: RowRecord) -> str:
    return record.row.title + (" (diverged)" if record.diverged else "")


def _row_title(records: Records, name: str) -> str:
    return next((r.row.title for r in records.rows if r.row.name == name), name)


def to_markdown(table: Table) -> str:
    """Return a table as Markdown with its heading and note."""
    lines = [f"## {table.title}", "", f"| {' | '.join(table.head)} |"]
    lines.append("|---|" + "---:|" * (len(table.head) - 1))
    lines += [f"| {' | '.join(row)} |" for row in table.rows]
    return "\n".join([*lines, *(["", table.note] if table.note else []), ""])
