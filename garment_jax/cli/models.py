"""`garment-jax models`: the models that come with the package, and where their pictures are."""

import argparse
import json
from pathlib import Path
from typing import Any

from garment_jax.cli.next_step import say_next
from garment_jax.cli.parser import add_command


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands,
        "models",
        examples="  garment-jax models",
        does="list the models that come with the package",
        description="What `garment-jax animate NAME` takes. RMSE is the mean over the test clips of "
        "figures.json, ms a frame that of variants.json or figures.json, on the machines named there.",
    )
    parser.set_defaults(begins="", run=run)


def run(options: argparse.Namespace) -> None:
    """Run it."""
    from garment_jax.model.shipped import shipped_models

    rows = [model_row(name, folder) for name, folder in shipped_models().items()]
    if not rows:
        raise ValueError("no models came with this package; save your own with garment-jax save.")
    heads = ("name", "vertices", "MB", "ms/frame", "RMSE cm", "picture")
    widths = [max(len(row[i]) for row in (heads, *rows)) for i in range(len(heads))]
    for row in (heads, *rows):
        print("  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip())
    say_next("animate", rows[0][0], why="see it move")


def model_row(name: str, folder: Path) -> tuple[str, ...]:
    """Return a model's name, vertices, size, run time, error and picture as texts; "-" for what is not there.

    Raises `ValueError` for a damaged file of figures.
    """
    from garment_jax.model.folder import FACTS, PICTURE

    facts, figures, variants = (_read(folder / n) for n in (FACTS, "figures.json", "variants.json"))
    size = sum(path.stat().st_size for path in folder.iterdir() if path.is_file()) / 1e6
    errors = [clip["rmse_cm"] for clip in figures.get("clips", {}).values()]
    times = [v["ms"] for v in variants.get("variants", []) if v["name"] == "whole"]
    ms = next(iter(times), figures.get("ms_per_frame"))
    picture = folder / PICTURE
    return (
        name,
        str(facts.get("vertices", "-")),
        f"{size:.1f}",
        "-" if ms is None else f"{ms:.1f}",
        f"{sum(errors) / len(errors):.2f}" if errors else "-",
        str(picture) if picture.is_file() else "-",
    )


def _read(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path} is damaged ({error}); copy the model again.") from error
