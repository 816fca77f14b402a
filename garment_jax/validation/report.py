"""The validator's findings as text and as JSON."""

from collections import Counter

from garment_jax.importers.finding import SEVERITIES, Finding
from garment_jax.validation.fixes import Fixed
from garment_jax.validation.validate import Report

_LONGEST = 1000  # characters of a value; damaged files bring texts of any length


def format_report(report: Report, *, everything: bool = False) -> str:
    """Return one file's table: severity, check, what was measured and where, and what helps."""
    shown = [f for f in report.findings if everything or f.severity != "ok"]
    head = f"{report.path} ({report.kind}): {_counted(report.findings)}"
    shown.sort(key=lambda finding: -SEVERITIES.index(finding.severity))
    wide = max((len(finding.check) for finding in shown), default=0)
    return "\n".join([head, *(_row(finding, wide) for finding in shown)])


def format_totals(reports: list[Report]) -> str:
    """Return the last line: how much of each severity was found."""
    findings = [finding for report in reports for finding in report.findings]
    files = sum(report.kind != "set" for report in reports)
    return f"{files} file{'s' if files != 1 else ''}: {_counted(findings)}"


def to_json(reports: list[Report], fixed: list[Fixed]) -> dict:
    """Return what `--json` prints."""
    return {
        "files": [
            {
                "path": report.path,
                "kind": report.kind,
                "findings": [
                    finding._asdict() | {"repair": finding.repair._asdict() if finding.repair else None}
                    for finding in report.findings
                ],
            }
            for report in reports
        ],
        "fixed": [
            {
                "source": str(one.source),
                "path": None if one.path is None else str(one.path),
                "done": one.done,
                "refused": one.refused,
            }
            for one in fixed
        ],
    }


def _row(finding: Finding, wide: int) -> str:
    place = f" [{finding.where}]" if finding.where else ""
    remedy = f"\n{'':{wide + 13}}-> {finding.remedy}" if finding.remedy else ""
    value = finding.value if len(finding.value) <= _LONGEST else f"{finding.value[:_LONGEST]} ..."
    return f"  {finding.severity:<8} {finding.check:<{wide}}  {value}{place}{remedy}"


def _counted(findings: list[Finding]) -> str:
    counts = Counter(finding.severity for finding in findings)
    listed = [
        f"{counts[severity]} {severity}{'s' if counts[severity] != 1 else ''}"
        for severity in reversed(SEVERITIES[1:])
        if counts[severity]
    ]
    return f"{', '.join(listed) or 'ok'} in {len(findings)} checks"
