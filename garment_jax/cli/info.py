"""`garment-jax info`: what is in a sequence file, a run or a model."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from garment_jax.cli.parser import add_command

EXAMPLES = """  garment-jax info pred.h5 models/skirt runs/mine
  garment-jax info runs/mine --all"""


def add(commands) -> None:
    """Add the command to the subparsers."""
    parser = add_command(
        commands, "info", does="say what is in a sequence file, a run or a model", examples=EXAMPLES
    )
    parser.add_argument("paths", nargs="+", type=Path, help="sequence files, runs, models")
    parser.add_argument("--json", action="store_true", help="machine-readable, one object per path")
    parser.add_argument("--all", action="store_true", help="every fact, not ten lines")
    parser.set_defaults(begins="", run=run)


def run(options: argparse.Namespace) -> int:
    """Run it; 2 if anything could not be read, which keeps nothing else from being told."""
    from garment_jax.io.brief import brief_description
    from garment_jax.io.formats.damage import reading
    from garment_jax.io.info import format_description
    from garment_jax.model.shipped import shipped_model

    show = format_description if options.all else brief_description

    facts, refused = {}, False
    for given in options.paths:
        path = given if given.exists() else shipped_model(given) or given
        try:
            with reading(path):
                found = facts[str(path)] = _describe(path)
        except (ValueError, OSError) as error:
            print(f"error: {error}", file=sys.stderr)
            refused = True
            continue
        if not options.json:
            print(("\n" if len(facts) > 1 else "") + show(str(path), found), flush=True)
    if options.json and facts:
        print(json.dumps(facts, indent=2))
    return 2 if refused else 0


def _describe(path: Path) -> dict[str, Any]:
    """Return the facts of a file or folder; of a saved model also what it is, which finds damage."""
    from garment_jax.io.info import describe

    facts = describe(path)
    if not (path / "model.json").is_file():
        return facts
    from garment_jax.model.store import model_facts  # with jax, which the others do without

    model = model_facts(path)
    about = {"vertices": model.vertices, "fps": model.fps, "parts": sorted(model.parts)}
    return {"model": about, **facts}
