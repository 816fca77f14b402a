"""What every benchmark says about itself: a table under the machine's line, and a JSON file."""

from pathlib import Path

from garment_jax.bench.files import write_json
from garment_jax.machine import machine


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
        write_json(json_path, {"title": title, "machine": where, "facts": facts, "rows": rows})


def _spell(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
