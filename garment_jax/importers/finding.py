"""What a check found: one row of the validator's table."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

SEVERITIES = ("ok", "note", "warning", "error")

_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
# what `validate` has; other options that a reader's sentence names are those of `import` and `simulate`
_CHECKED_WITH = ("--garment", "--fps", "--mesh", "--skeleton", "--animation", "--out", "--fix")


class Repair(NamedTuple):
    """A change that is safe to make, and how much of it."""

    kind: str  # see `raw_clip.RawClip.repair`
    amount: float = 0.0  # a factor, frames or frames a second


class Finding(NamedTuple):
    """One check's result.

    `note` is worth knowing, `warning` probably a fault, `error` spoils what is made of the file.
    """

    check: str
    severity: str  # one of SEVERITIES
    value: str  # what was measured, with its unit
    where: str = ""  # frame, vertex, face, joint; the first of several
    remedy: str = ""
    repair: Repair | None = None  # where `--fix` may act

    def sentence(self, name: str) -> str:
        """Return the finding as a refusal of the file `name`."""
        place = f" ({self.where})" if self.where else ""
        return f"{name}: {self.value}{place}{'; ' if self.remedy else ''}{self.remedy}."


def worst(findings: Iterable[Finding]) -> str:
    """Return the highest severity, "ok" for none."""
    return max((finding.severity for finding in findings), key=SEVERITIES.index, default="ok")


def rows(name: str, indices: np.ndarray | list[int], *, shown: int = 3) -> str:
    """Return where something was first found: "faces 3, 4, 9 …"."""
    listed = [int(index) for index in indices]
    if not listed:
        return ""
    several = {"vertex": "vertices"}.get(name, name + "s")
    more = " …" if len(listed) > shown else ""
    return f"{several if len(listed) > 1 else name} {', '.join(map(str, listed[:shown]))}{more}"


def refusal(error: Exception, path: Path) -> Finding:
    """Return a reader's sentence as a finding."""
    text = str(error).removeprefix(str(path)).lstrip(": ").rstrip(".")
    value, _, remedy = text.partition("; ")
    lacking = [option for option in _OPTION.findall(remedy) if option not in _CHECKED_WITH]
    remedy += " when it is imported" if lacking else ""
    if "packed for transport" in text:
        return Finding("readable", "note", value, remedy=remedy or "import it first")
    return Finding("readable", "error", value, remedy=remedy)
