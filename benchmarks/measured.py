"""What every benchmark says about itself: the machine, the date, its memory, a table and a JSON file."""

import datetime
import json
import os
import platform
import resource
from pathlib import Path

import jax

MEGABYTE = 1e6


def machine() -> dict[str, str]:
    """Return processor, cores, load, versions and date: without them a figure says nothing."""
    device = jax.devices()[0]
    return {
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "load": f"{os.getloadavg()[0]:.1f}",
        "device": f"{device.platform} {device.device_kind}",
        "jax": jax.__version__,
        "python": platform.python_version(),
        "date": datetime.datetime.now().astimezone().isoformat(timespec="minutes"),
    }


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def resident_mb() -> float:
    """Return the memory that this process holds now, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / MEGABYTE


def peak_mb() -> float:
    """Return the most memory that this process has held, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / MEGABYTE


def report(rows: list[dict], *, title: str, facts: dict, json_path: Path | None) -> None:
    """Print `rows` (dicts of equal keys) as a table under the machine's line, and write them as JSON."""
    where = machine()
    print(f"\n{title}")
    print(
        f"{where['processor']}, {where['cores']} cores, load {where['load']}, {where['device']}, "
        f"jax {where['jax']}, {where['date']}"
    )
    if facts:
        print(", ".join(f"{key} {_spell(value)}" for key, value in facts.items()))
    names = list(rows[0])
    cells = [names, *([_spell(row[name]) for name in names] for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(names))]
    for row in cells:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    if json_path is not None:
        json_path.parent.mkdir(parents=True, exist_ok=True)
        json_path.write_text(
            json.dumps({"title": title, "machine": where, "facts": facts, "rows": rows}, indent=1)
        )


def _spell(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
