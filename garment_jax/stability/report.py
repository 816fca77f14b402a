"""`garment-jax stability`: all groups of cases, their tables, a JSON file and plots."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from garment_jax.stability.case import RED, Case, Curve, Findings
from garment_jax.stability.deep import deep_cases
from garment_jax.stability.extreme import extreme_cases
from garment_jax.stability.numbers import numbers_cases
from garment_jax.stability.precision import precision_cases
from garment_jax.stability.self_contact import self_contact_cases
from garment_jax.stability.skinning import skinning_cases
from garment_jax.stability.stiff import stiff_cases
from garment_jax.stability.subject import Subject, load_subject
from garment_jax.stability.table import format_cases, summary
from garment_jax.stability.training import training_cases
from garment_jax.storage.whole import write_text

GROUPS: dict[str, Callable[[Subject], Findings]] = {
    "skinning": skinning_cases,
    "stiff": stiff_cases,
    "deep": deep_cases,
    "self-contact": self_contact_cases,
    "extreme motion": extreme_cases,
    "numbers": numbers_cases,
    "precision": precision_cases,
    "training": training_cases,
}


def stability(
    run: str | Path | None,
    *,
    garment: str | None = None,
    clips: Sequence[str | Path] = (),
    full: bool = False,
    only: Sequence[str] = (),
    out: str | Path | None = None,
    show: Callable[[str], object] = print,
) -> list[Case]:
    """Run the groups of cases (`only` some of them), show a table each, and return all cases.

    Without `run` what needs a network is left out, by name. Into the folder `out` go stability.json and
    the plots. Raises `ValueError` or `OSError` for what cannot be read or written.
    """
    unknown = set(only) - set(GROUPS)
    if unknown:
        raise ValueError(f"--only {sorted(unknown)[0]!r} is unknown; choose of {', '.join(GROUPS)}.")
    subject = load_subject(run, garment=garment, clips=clips, full=full)
    if out is not None:
        Path(out).mkdir(parents=True, exist_ok=True)
    cases: list[Case] = []
    curves: list[Curve] = []
    for name in only or GROUPS:
        show(f"\n## {name}: {subject.name}\n")
        found = GROUPS[name](subject)
        show(format_cases(found.cases))
        cases, curves = cases + found.cases, curves + list(found.curves)
        if out is not None:  # after every group: a stopped report is worth something
            _write(Path(out) / "stability.json", _facts(subject, run, cases, curves))
    if out is not None:
        from garment_jax.stability.plots import save_plots  # matplotlib: where something is drawn

        for path in save_plots(Path(out), curves):
            show(str(path))
    show(f"\n{summary(cases)}")
    return cases


def passed(cases: Sequence[Case]) -> bool:
    """Return whether nothing is red; what was left out does not count."""
    return all(case.verdict != RED for case in cases)


def _facts(
    subject: Subject, run: str | Path | None, cases: Sequence[Case], curves: Sequence[Curve]
) -> dict[str, Any]:
    return {
        "subject": subject.name,
        "run": None if run is None else str(run),
        "full": subject.full,
        "passed": passed(cases),
        "cases": [case._asdict() for case in cases],
        "curves": [_plain(curve) for curve in curves],
    }


def _plain(curve: Curve) -> dict[str, Any]:
    return curve._asdict() | {"x": [float(x) for x in curve.x], "y": [float(y) for y in curve.y]}


def _write(path: Path, facts: dict[str, Any]) -> None:
    """Write JSON, whole or not at all; a NaN becomes null."""
    write_text(path, json.dumps(_finite(facts), indent=1, ensure_ascii=False) + "\n")


def _finite(x: Any) -> Any:
    if isinstance(x, dict):
        return {key: _finite(value) for key, value in x.items()}
    if isinstance(x, list):
        return [_finite(value) for value in x]
    return None if isinstance(x, float) and not abs(x) < float("inf") else x
