"""One line of the stability report, and the verdicts that it can carry."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, SupportsFloat

import numpy as np

GREEN, RED, LEFT_OUT, INFO = "green", "red", "left out", "info"


class Case(NamedTuple):
    """One quantity of one case."""

    group: str
    case: str
    quantity: str
    value: float | str
    unit: str
    bound: str  # empty where nothing is promised
    verdict: str  # GREEN, RED, LEFT_OUT (the value says why) or INFO (no promise)


class Curve(NamedTuple):
    """One line of a plot of the report."""

    plot: str  # name of the picture
    label: str
    x: Sequence[float]
    y: Sequence[float]


class Findings(NamedTuple):
    """What a group of cases found."""

    cases: list[Case]
    curves: list[Curve] = []  # noqa: RUF012 (a NamedTuple's default; nobody appends to it)


def at_most(group: str, case: str, quantity: str, value: SupportsFloat, bound: float, unit: str) -> Case:
    """Return a case that is green where `value` is `bound` or less; NaN is red."""
    value = float(value)
    return Case(group, case, quantity, value, unit, f"<= {bound:.4g}", GREEN if value <= bound else RED)


def at_least(group: str, case: str, quantity: str, value: SupportsFloat, bound: float, unit: str) -> Case:
    """Return a case that is green where `value` is `bound` or more; NaN is red."""
    value = float(value)
    return Case(group, case, quantity, value, unit, f">= {bound:.4g}", GREEN if value >= bound else RED)


def holds(group: str, case: str, quantity: str, value: str, bound: str, ok: bool) -> Case:
    """Return a case in words that is green where `ok`."""
    return Case(group, case, quantity, value, "", bound, GREEN if ok else RED)


def info(group: str, case: str, quantity: str, value: SupportsFloat, unit: str = "") -> Case:
    """Return a line that promises nothing and explains others."""
    return Case(group, case, quantity, float(value), unit, "", INFO)


def left_out(group: str, case: str, why: str) -> Case:
    """Return the line of a case that was not run, with the reason as its value."""
    return Case(group, case, "", why, "", "", LEFT_OUT)


def finite(group: str, case: str, quantity: str, *arrays) -> Case:
    """Return a case that is green where every number of `arrays` is finite."""
    bad = sum(int((~np.isfinite(np.asarray(a, np.float64))).sum()) for a in arrays)
    return Case(group, case, quantity, float(bad), "not finite", "<= 0", GREEN if bad == 0 else RED)


def refused(
    group: str, case: str, attempt: Callable[[], object], words: Sequence[str], *, hide: str = ""
) -> Case:
    """Return a case that is green where `attempt` raises a one-sentence ValueError that holds `words`.

    `hide`, the path of a temporary folder, is left out of the sentence shown.
    """
    try:
        attempt()
    except (ValueError, OSError) as error:
        said = str(error).replace(hide, "") if hide else str(error)
        ok = "\n" not in said and all(word in said for word in words)
        return holds(group, case, "refused", said, f"a sentence with {', '.join(words)}", ok)
    return holds(group, case, "refused", "accepted in silence", "a sentence", False)


def spell(value: float | str) -> str:
    """Return a value as the table prints it."""
    if isinstance(value, str):
        return value
    if math.isfinite(value) and value == round(value) and abs(value) < 1e6:
        return str(round(value))
    return f"{value:.3g}"
