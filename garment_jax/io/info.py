"""`garment-jax info`: what is in a sequence file, a run or a model, as plain facts."""

import json
import math
import tomllib
from pathlib import Path
from typing import Any

from garment_jax.io.content_hash import body_hash, garment_hash
from garment_jax.io.sequence import Sequence, open_sequence
from garment_jax.io.validation import measure_extent


def describe(path: str | Path) -> dict[str, Any]:
    """Return the facts of a sequence file, or a folder's configuration and figures; JSON-able."""
    path = Path(path)
    if path.is_dir():
        return _describe_folder(path)
    with open_sequence(path) as sequence:
        return _describe_sequence(sequence)


def format_description(path: str, facts: dict[str, Any]) -> str:
    """Return the facts as lines of text under the path."""
    rows = _flatten(facts)
    width = max((len(key) for key, _ in rows), default=0)
    return "\n".join([path, *(f"  {key:<{width}}  {value}" for key, value in rows)])


def _describe_sequence(sequence: Sequence) -> dict[str, Any]:
    garment, body = sequence.scene.garment, sequence.scene.body
    pins, collider = sequence.scene.pins, sequence.scene.collider
    facts: dict[str, Any] = {
        "kind": sequence.attributes.get("kind", "unknown"),
        "name": sequence.name,
        "frames": sequence.frames,
        "fps": sequence.fps,
        "duration_s": round(sequence.frames / sequence.fps, 3),
        "length_unit": sequence.attributes["length_unit"],
        "up_axis": sequence.attributes["up_axis"],
        "encoding": sequence.encoding,
        "garment": {
            "vertices": len(garment.template),
            "faces": len(garment.faces),
            "texture_vertices": len(garment.uv),
            "pins": 0 if pins is None else len(pins.vertices),
            "hash": garment_hash(garment),
        },
        "body": {
            "vertices": len(body.vertices),
            "collider_faces": 0 if collider is None else len(collider.faces),
            "joints": len(body.joint_names),
            "joint_names": list(body.joint_names),
            "hash": body_hash(body),
        },
    }
    if sequence.encoding != "none":
        extent = measure_extent(sequence)
        corners = (extent.low, extent.high)
        facts["extent_m"] = [[round(float(value), 3) for value in corner] for corner in corners]
        facts["reach_m"], facts["movement_m"] = round(extent.reach, 4), round(extent.movement, 4)
    shown = {*facts, "kind", "fps", "length_unit", "up_axis"}
    facts |= {key: _strict(value) for key, value in sequence.attributes.items() if key not in shown}
    if sequence.extra_names:
        facts["extra"] = list(sequence.extra_names)
    return facts


def _strict(value: Any) -> Any:
    """Return an attribute as strict JSON has it, which knows no NaN."""
    if isinstance(value, list):
        return [_strict(entry) for entry in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _describe_folder(path: Path) -> dict[str, Any]:
    facts: dict[str, Any] = {}
    if (path / "config.toml").is_file():
        facts["config"] = _parse(path / "config.toml")
    if (path / "figures.json").is_file():
        facts["figures"] = _parse(path / "figures.json")
    if not facts:
        raise ValueError(
            f"{path} is neither a run nor a model (no config.toml, no figures.json); give a sequence file or "
            "a run's folder."
        )
    return facts


def _parse(path: Path) -> Any:
    try:
        text = path.read_text(encoding="utf-8")
        return tomllib.loads(text) if path.suffix == ".toml" else json.loads(text)
    except (tomllib.TOMLDecodeError, json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{path} cannot be read ({error}); write it again.") from error


def _flatten(facts: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    for key, value in facts.items():
        if isinstance(value, dict):
            rows += _flatten(value, f"{prefix}{key}.")
        else:
            text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
            rows.append((prefix + key, text))
    return rows
