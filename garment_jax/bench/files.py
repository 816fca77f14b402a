"""JSON files that appear whole or not at all."""

import json
from pathlib import Path
from typing import Any

from garment_jax.storage.whole import write_text


def write_json(path: Path, value: Any) -> None:
    """Write `value`, whole or not at all; a NaN becomes null."""
    write_text(path, json.dumps(finite(value), indent=1, ensure_ascii=False) + "\n")


def read_json(path: Path) -> Any:
    """Read a JSON file; `ValueError` in a sentence for a damaged one."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is damaged ({error}); delete it and run the same command again.") from error


def finite(value: Any) -> Any:
    """Return `value` with every number that is not finite replaced by None."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not abs(value) < float("inf") else value
