"""Everything measured so far as `report.md`, `report.json`, `report.csv` and `report.html`."""

import csv
import io
import json
from pathlib import Path
from typing import Any

from garment_jax.bench import paper
from garment_jax.bench.files import finite
from garment_jax.bench.page import make_page
from garment_jax.bench.plan import Plan
from garment_jax.bench.records import Records, gather
from garment_jax.bench.tables import (
    Table,
    clip_table,
    comparison_table,
    cost_table,
    detail_table,
    error_table,
    previous_state_table,
    provenance_table,
    ratio_table,
    search_table,
    to_markdown,
    vto_table,
)
from garment_jax.machine import machine
from garment_jax.storage.whole import write_text

UNMEASURED = {"sted_window_frames": 15, "sted_c": 0.1, "penetration_tolerance_mm": 0.1}
VTO_COMMAND = "garment-jax benchmark configs/benchmark_vto.toml --data DIR"


def write_report(plan: Plan, told: dict[str, Any]) -> list[Path]:
    """Write the four files, plots and pictures; return the four paths."""
    from garment_jax.bench.pictures import all_pictures  # matplotlib: where something is drawn
    from garment_jax.bench.plots import all_plots

    records = gather(plan)
    tables = make_tables(records, plan)
    facts = describe(records, told)
    pictures = all_pictures(records, plan.test, plan.out)
    plots = all_plots(records, plan.settings.lengths)
    drawn = write_plots(plots, plan.out)
    values = finite(as_json(records, tables, told))
    texts = {
        "report.md": markdown(records, tables, facts, drawn, pictures, plan.out),
        "report.json": json.dumps(values, indent=1, ensure_ascii=False) + "\n",
        "report.csv": as_csv(records),
        "report.html": make_page(records.title, facts, plots, pictures, tables, notes(records)),
    }
    for name, text in texts.items():
        write_text(plan.out / name, text)
    return [plan.out / name for name in texts]


def write_plots(plots: dict[str, str], out: Path) -> dict[str, Path]:
    """Write title -> SVG into `out/plots` and return title -> file: for other documents than the page."""
    folder = out / "plots"
    folder.mkdir(parents=True, exist_ok=True)
    paths = {title: folder / f"{title.lower().replace(',', '').replace(' ', '_')}.svg" for title in plots}
    for title, path in paths.items():
        write_text(path, plots[title] + "\n")
    return paths


def make_tables(records: Records, plan: Plan) -> list[Table]:
    """Return all tables, in the order of the report."""
    reference = plan.settings.reference
    settings = next((r.rolls[0]["settings"] for r in records.rows if r.rolls), None)
    tables = [
        error_table(records, settings or UNMEASURED | {"every": plan.settings.every}),
        cost_table(records),
        clip_table(records),
        previous_state_table(records, plan.settings.lengths),
        detail_table(records),
        *_comparisons(records, plan, reference),
        ratio_table(records, reference),
        search_table(records),
        provenance_table(records, plan.out),
    ]
    return tables


def _comparisons(records: Records, plan: Plan, reference: str) -> list[Table]:
    """Return Tables 3 and 4; a benchmark whose garment is the vto-dataset's fills the fourth."""
    if plan.settings.compared_with == "vto":
        return [comparison_table(records, reference, paper.VTO, title="Table 4: vto-dataset")]
    skirt = comparison_table(records, reference, paper.SKIRT, title="Table 3: against the others")
    return [skirt, vto_table(VTO_COMMAND)]


def describe(records: Records, told: dict[str, Any]) -> str:
    """Return one paragraph: command, clips, machine, versions, dates."""
    command = f"garment-jax benchmark {told['benchmark']}" + (" --quick" if told["quick"] else "")
    here = next((r.rolls[0]["machine"] for r in records.rows if r.rolls), None) or machine()
    dates = sorted(roll["machine"]["date"][:10] for r in records.rows for roll in r.rolls) or [
        here["date"][:10]
    ]
    span = dates[0] if dates[0] == dates[-1] else f"{dates[0]} to {dates[-1]}"
    versions = ", ".join(f"{name} {here[name]}" for name in ("garment-jax", "jax", "flax", "numpy"))
    measured = sum(bool(r.rolls) for r in records.rows)
    return (
        f"{command} · {measured} of {len(records.rows)} rows measured · test clips: "
        f"{', '.join(records.clips)} · {here['processor']}, {here['cores']} cores, {here['device']}, "
        f"Python {here['python']}, {versions} · {span}"
    )


def notes(records: Records) -> dict[str, str]:
    """Return the sentences that stand under plots and pictures."""
    found = {
        "Error against run time": "Milliseconds include pins and, unless a row says otherwise, limb and "
        "collision handling. The dashed line joins what nothing else beats in both. A triangle's error is "
        "off it.",
        "Error against training time": "Lines: the clip kept back, rolled out during training; a stage's "
        "seconds count after those before it. Diamonds: test error at the end.",
        "Methods on an unseen motion": "The longest test clip, whole rollouts.",
    }
    if records.latent is not None:
        s = records.latent
        found["Between two latents"] = (
            f"{s['steps']} shapes decoded evenly between the latents of two true frames (blue: the ends). "
            f"Median of {s['pairs']} random pairs: {s['step_mm']:.1f} mm a step, second difference "
            f"{s['bend_mm']:.2f} mm, ratio {s['ratio']:.3f} (worst {s['ratio_worst']:.3f}); "
            "0 is a straight and even path."
        )
    return found


def markdown(
    records: Records,
    tables: list[Table],
    facts: str,
    plots: dict[str, Path],
    pictures: dict[str, Path],
    out: Path,
) -> str:
    """Return the report as Markdown; plots and pictures are linked."""
    lines, said = [f"# {records.title}", "", facts, ""], notes(records)
    for name, path in plots.items():
        lines += _linked(name, path.relative_to(out), said)
    lines += [to_markdown(table) for table in tables]
    for name, path in pictures.items():
        lines += _linked(name, path.relative_to(out), said)
    return "\n".join(lines)


def _linked(name: str, path: Path, said: dict[str, str]) -> list[str]:
    return [f"## {name}", "", f"![{name}]({path.as_posix()})", "", said.get(name, ""), ""]


def as_json(records: Records, tables: list[Table], told: dict[str, Any]) -> dict[str, Any]:
    """Return everything known, per clip and per seed, as JSON values."""
    rows = [
        {"name": r.row.name, "title": r.row.title, "group": r.row.group, "method": r.row.method}
        | {"seeds": list(r.row.seeds), "measured": r.rolls, "trained": r.trained, "time": r.time}
        for r in records.rows
    ]
    return {
        "title": records.title,
        "command": told,
        "clips": records.clips,
        "rows": rows,
        "searches": records.searches,
        "simulator": records.simulator,
        "latent": records.latent,
        "floor": records.floor,
        "tables": [table._asdict() for table in tables],
    }


def as_csv(records: Records) -> str:
    """Return one line a row, seed and clip with every metric and the row's run time."""
    metrics = sorted(
        {m for r in records.rows for roll in r.rolls for c in roll["clips"].values() for m in c["metrics"]}
    )
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["row", "method", "seed", "run", "clip", "frames", "ms_per_frame", *metrics])
    for r in records.rows:
        speed = (r.time or {}).get("ms_per_frame", "")
        for roll in r.rolls:
            for name, clip in roll["clips"].items():
                values = ["" if clip["metrics"].get(m) is None else clip["metrics"][m] for m in metrics]
                writer.writerow(
                    [
                        r.row.name,
                        r.row.method,
                        roll["seed"],
                        roll["run"],
                        name,
                        clip["frames"],
                        speed,
                        *values,
                    ]
                )
    return file.getvalue()
