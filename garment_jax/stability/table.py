"""The report as Markdown tables, one a group."""

from collections.abc import Sequence

from garment_jax.stability.case import GREEN, INFO, LEFT_OUT, RED, Case, spell

_HEADINGS = ("case", "quantity", "value", "bound", "verdict")


def format_cases(cases: Sequence[Case]) -> str:
    """Return the cases of one group as a Markdown table in columns; a red verdict stands out."""
    rows = [_HEADINGS, *(_row(case) for case in cases)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(_HEADINGS))]
    lines = ["| " + " | ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) + " |" for row in rows]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return "\n".join(lines)


def _row(case: Case) -> tuple[str, ...]:
    value = f"{spell(case.value)} {case.unit}".strip().replace("|", "/")
    verdict = "**red**" if case.verdict == RED else case.verdict
    return case.case, case.quantity, value, case.bound, verdict


def summary(cases: Sequence[Case]) -> str:
    """Return how many cases are green, red and left out, with the names of the red ones."""
    count = {v: sum(case.verdict == v for case in cases) for v in (GREEN, RED, LEFT_OUT, INFO)}
    line = f"{count[GREEN]} green, {count[RED]} red, {count[LEFT_OUT]} left out"
    reds = [f"{case.group}: {case.case}, {case.quantity}" for case in cases if case.verdict == RED]
    return "\n".join([line, *(f"red: {name}" for name in reds)])
