"""Evaluation results as a Markdown table."""

from collections.abc import Sequence
from typing import Any

from garment_jax.evaluation.summary import mean_metrics

COLUMNS: tuple[tuple[str, str, str], ...] = (  # heading, metric, format
    ("RMSE cm", "rmse_cm", ".2f"),
    ("mean dist. cm", "mean_distance_cm", ".2f"),
    ("Hausdorff cm", "hausdorff_cm", ".2f"),
    ("STED", "sted", ".4f"),
    ("drift ratio", "drift_ratio", ".2f"),
    ("inside %", "inside_percent", ".2f"),
    ("deepest mm", "deepest_mm", ".1f"),
    ("pinched %", "pinched_percent", ".2f"),
    ("pierced frames %", "pierced_percent", ".1f"),
    ("of truth %", "truth_pierced_percent", ".1f"),
    ("self-int. edges", "self_intersecting_edges", ".1f"),
    ("of truth", "truth_self_intersecting_edges", ".1f"),
    ("self-pen. cm²", "self_penetrating_cm2", ".1f"),
    ("of truth", "truth_self_penetrating_cm2", ".1f"),
    ("hem height diff. cm", "hem_height_difference_cm", "+.2f"),
    ("hem motion ÷ truth", "hem_motion_std_ratio", ".2f"),
    ("strain %", "strain_mean_percent", ".2f"),
    ("of truth %", "truth_strain_mean_percent", ".2f"),
    ("Laplacian power ÷ truth", "laplacian_power_ratio", ".2f"),
    ("speed ÷ truth", "speed_mean_ratio", ".2f"),
    ("silhouette ÷ truth", "silhouette_ratio", ".2f"),
)

SIDE_BY_SIDE = 8  # clips, more do not fit beside each other

AGAINST_AGAIN = (
    ("determined %", "determined_percent", ".0f"),
    ("RMSE there cm", "determined_rmse_cm", ".2f"),
    ("÷ second run elsewhere", "parted_error_ratio", ".2f"),
)

REST_OF_THE_BODY = (
    ("arms inside %", "arms_inside_percent", ".2f"),
    ("of truth %", "truth_arms_inside_percent", ".2f"),
    ("arms deepest mm", "arms_deepest_mm", ".1f"),
    ("of truth mm", "truth_arms_deepest_mm", ".1f"),
)


def format_table(results: dict[str, Any] | Sequence[dict[str, Any]], *, whole_body: bool = False) -> str:
    """Return a Markdown table of one or several `evaluate_files` results: a metric a line, a clip a column.

    Figures against a second simulation come first. With `whole_body` also the penetration of what is not part
    of the collider. Several clips get their mean; more than `SIDE_BY_SIDE` of them a line each. A dash stands
    for a metric that does not apply.
    """
    rows = [results] if isinstance(results, dict) else list(results)
    known = AGAINST_AGAIN if any("again" in row for row in rows) else ()
    columns = known + COLUMNS + (REST_OF_THE_BODY if whole_body else ())
    table = [["clip", "frames", *(heading for heading, _, _ in columns)]]
    table += [_cells(str(r["clip"]), r["frames"], r["metrics"], columns) for r in rows]
    if len(rows) > 1:
        total = sum(r["frames"] for r in rows)
        table.append(_cells(f"mean of {len(rows)}", total, mean_metrics(rows), columns))
    lines = table if len(rows) > SIDE_BY_SIDE else list(map(list, zip(*table, strict=True)))
    return _aligned(lines) + "\n" + _footnote(rows[0]["settings"])


def _cells(clip: str, frames: int, metrics: dict[str, float | None], columns: tuple) -> list[str]:
    return [clip, str(frames), *(_cell(metrics.get(name), form) for _, name, form in columns)]


def _aligned(lines: list[list[str]]) -> str:
    """Return a Markdown table whose columns line up in a terminal; the first one to the left."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    rule = [f"{'-' * widths[0]}--", *(f"{'-' * (width + 1)}:" for width in widths[1:])]
    text = [
        "| " + " | ".join([line[0].ljust(widths[0]), *map(str.rjust, line[1:], widths[1:])]) + " |"
        for line in lines
    ]
    return "\n".join([text[0], f"|{'|'.join(rule)}|", *text[1:]])


def _cell(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def _footnote(settings: dict[str, Any]) -> str:
    return (
        f"\nSTED over the {settings['sted_neighbourhood']}, window {settings['sted_window_frames']} frames, "
        f"c = {settings['sted_c']:g}. Hausdorff, inside, deepest and self-intersections on one frame in "
        f"{settings['every']}; inside = more than {settings['penetration_tolerance_mm']:g} mm deep; "
        "pinched = those of them where the collider crosses itself; "
        "pierced = a limb runs through the cloth.\n"
    )
