"""What matters of a file's or a folder's facts, in ten lines; `info --all` has the rest."""

from collections.abc import Mapping
from typing import Any

LINES = 10  # with the path
WIDTH = 100  # characters of a value
STAGES = ("generative", "motion", "detail", "column_rnn")
# of a sequence: told in words, or of interest to programs; the rest follows, as long as there is room
_TOLD = {
    "kind",
    "name",
    "frames",
    "fps",
    "duration_s",
    "length_unit",
    "up_axis",
    "garment",
    "body",
    "extent_m",
}
_FOR_PROGRAMS = {"encoding", "scene_hash", "schema_version", "reach_m", "movement_m", "extra"}


def brief_description(path: str, facts: Mapping[str, Any]) -> str:
    """Return at most ten lines: the path, and the facts of `describe` that say what it is."""
    rows = _sequence(facts) if "frames" in facts else _folder(facts)
    width = max((len(key) for key, _ in rows), default=0)
    lines = [f"  {key:<{width}}  {_short(value)}" for key, value in rows][: LINES - 2]
    return "\n".join([path, *lines, "  (--all: every fact; --json: for programs)"])


def _sequence(facts: Mapping[str, Any]) -> list[tuple[str, str]]:
    garment, body = facts["garment"], facts["body"]
    rows = [
        (facts["kind"], facts["name"]),
        ("length", f"{facts['frames']} frames at {facts['fps']:g} fps, {facts['duration_s']:g} s"),
        ("garment", f"{garment['vertices']} vertices, {garment['faces']} faces, {garment['pins']} pinned"),
        (
            "body",
            f"{body['vertices']} vertices, {body['joints']} joints, "
            f"{body['collider_faces'] or 'no'} faces to collide with",
        ),
    ]
    if "extent_m" in facts:
        size = [high - low for low, high in zip(*facts["extent_m"], strict=True)]
        rows.append(("space", f"{' x '.join(f'{side:.2f}' for side in size)} m, {facts['up_axis']} up"))
    return rows + [(key, _text(value)) for key, value in facts.items() if key not in _TOLD | _FOR_PROGRAMS]


def _folder(facts: Mapping[str, Any]) -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    if model := facts.get("model"):
        parts = ", ".join(model["parts"])
        rows.append(("model", f"{model['vertices']} vertices at {model['fps']:g} fps: {parts}"))
    config = facts.get("config", {})
    steps = [f"{name} {_of(config, name, 'steps')}" for name in STAGES if _of(config, name, "steps")]
    rows += [("steps", ", ".join(steps))] if steps else []
    if data := _of(config, "data", "dir"):
        rows.append(("data", f"{data}, validated on {_text(_of(config, 'data', 'validation')) or 'nothing'}"))
    errors = clip_errors(facts.get("figures"))
    if errors:
        worst = max(errors, key=lambda name: errors[name])
        mean = sum(errors.values()) / len(errors)
        said = f", worst {errors[worst]:.2f} cm ({worst})" if len(errors) > 1 else ""
        rows.append(("error", f"RMSE {mean:.2f} cm, the mean of {len(errors)} clips{said}"))
    figures = facts.get("figures")
    told = (
        [(k, v) for k, v in figures.items() if k not in ("clips", "metrics")]
        if isinstance(figures, dict)
        else []
    )
    return rows + [(key, str(value)) for key, value in told if isinstance(value, str | int | float)]


def clip_errors(figures: Any) -> dict[str, float]:
    """Return the RMSE in cm by clip, of a model's figures.json or of what `evaluate --out` wrote."""
    if isinstance(figures, Mapping) and isinstance(figures.get("clips"), Mapping):
        found = {name: _of(figures["clips"], name, "rmse_cm") for name in figures["clips"]}
    else:
        clips = figures if isinstance(figures, list) else [figures]
        clips = [clip for clip in clips if isinstance(clip, Mapping)]
        found = {str(clip.get("clip", "?")): _of(clip, "metrics", "rmse_cm") for clip in clips}
    return {name: float(error) for name, error in found.items() if isinstance(error, int | float)}


def _of(table: Any, *keys: str) -> Any:
    """Return the value below the keys; None where a file has another form."""
    for key in keys:
        table = table.get(key) if isinstance(table, Mapping) else None
    return table


def _text(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else "" if value is None else str(value)


def _short(value: str) -> str:
    line = " ".join(value.split())
    return line if len(line) <= WIDTH else f"{line[: WIDTH - 2]} …"
